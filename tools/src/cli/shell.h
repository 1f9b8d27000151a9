#pragma once

#include <string>

#include "cli/command.h"

namespace revisit::cli {

/// Quotes a text as one word of a shell command.
std::string shell_word(const std::string& text);

/// Shell command of `program` (unquoted words) with quoted `arguments`.
std::string shell_command(const std::string& program, const Arguments& arguments);

}  // namespace revisit::cli
