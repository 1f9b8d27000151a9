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

std::span<const ProgramName> names_in_messages();

/// Message of an error with the program's name for each CppName.
std::string message_of(const Error& error);

/// Prints "note: ..." or "warning: ..." to standard error.
void note(const std::string& message);
void warn(const std::string& message);
void warn_skipped(const std::string& why);

}  // namespace revisit::cli
