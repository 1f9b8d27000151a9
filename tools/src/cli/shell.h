#pragma once

#include <string>
#include <vector>

#include "cli/options.h"

namespace revisit::cli {

std::string shell_word(const std::string& text);

/// Quotes the arguments, but not `program`, which may be several words.
std::string shell_command(const std::string& program, const Arguments& arguments);

/// Runs `arguments[0]` from PATH, which prints its errors to standard error and nothing else; an
/// interrupt ends it, too. Returns its exit code, 128 + N after signal N. Throws Error, with the
/// Debian `package`, if it cannot be started.
int run_program(std::vector<std::string> arguments, const std::string& package);

}  // namespace revisit::cli
