#pragma once

#include <filesystem>
#include <string>
#include <vector>

namespace revisit::cli {

/// Runs `arguments[0]` (looked for in PATH) in `folder`, without input and output, and waits for
/// it. Returns "" when it succeeded, else what went wrong: not installed (with the Debian `package`
/// that has it), not to be started, or failed.
std::string run_program(const std::filesystem::path& folder, std::vector<std::string> arguments,
                        const std::string& package);

}  // namespace revisit::cli
