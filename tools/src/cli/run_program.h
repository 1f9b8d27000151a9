#pragma once

#include <string>
#include <vector>

namespace revisit::cli {

/// Runs `arguments[0]` from PATH, which prints its errors to standard error and nothing else; an
/// interrupt ends it, too. Returns its exit code, 128 + N after signal N. Throws Error, with the
/// Debian `package`, if it cannot be started.
int run_program(std::vector<std::string> arguments, const std::string& package);

}  // namespace revisit::cli
