#pragma once

#include <span>
#include <string>
#include <string_view>

#include "revisit/base/error.h"

namespace revisit::cli {

struct ProgramName {
  std::string_view cpp;  // "LoadOptions::inputs", a CppName
  const char* here;      // "--input-shape"
};

/// Every CppName in messages of the libraries.
std::span<const ProgramName> names_in_messages();

/// The message of an error, with the program's name for each CppName.
std::string message_of(const Error& error);

/// "note: ..." and "warning: ..." on standard error.
void note(const std::string& message);
void warn(const std::string& message);
/// Of a scan that cannot be described.
void warn_left_out(const std::string& why);

}  // namespace revisit::cli
