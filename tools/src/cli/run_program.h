#pragma once

#include <filesystem>
#include <string>
#include <vector>

namespace revisit::cli {

/// Runs `arguments[0]` from PATH in `folder`. Returns "", or an error naming the Debian `package`.
std::string run_program(const std::filesystem::path& folder, std::vector<std::string> arguments,
                        const std::string& package);

}  // namespace revisit::cli
