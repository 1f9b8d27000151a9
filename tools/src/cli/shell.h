#pragma once

#include <string>

#include "cli/command.h"

namespace revisit::cli {

std::string shell_word(const std::string& text);

/// Quotes the arguments, but not `program`, which may be several words.
std::string shell_command(const std::string& program, const Arguments& arguments);

}  // namespace revisit::cli
