#pragma once

#include <span>
#include <string>

namespace revisit::cli {

/// What the messages of the libraries call a setting, and what the program calls it.
struct Setting {
  const char* field;  // "LoadOptions::inputs"
  const char* here;   // "--input-shape"
};

/// All fields and functions that messages of the libraries name.
std::span<const Setting> settings_in_messages();

/// A message of a library in the words of the program: its flags for fields of option structs.
std::string in_our_words(std::string message);

/// "note: ..." and "warning: ..." on standard error, in our words.
void note(const std::string& message);
void warn(const std::string& message);
/// Of a scan that cannot be described.
void warn_left_out(const std::string& why);

}  // namespace revisit::cli
