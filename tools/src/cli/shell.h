#pragma once

#include <string>

#include "cli/command.h"

namespace revisit::cli {

/// As one word of a shell command.
std::string shell_word(const std::string& text);

/// `program` (one or more words as they are) with `arguments`, to be given to a shell.
std::string shell_command(const std::string& program, const Arguments& arguments);

}  // namespace revisit::cli
