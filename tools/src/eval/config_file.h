#pragma once

#include <filesystem>
#include <string>
#include <utility>
#include <vector>

namespace revisit::cli {

/// Reads a flat YAML map for Options::config(). Throws InputError with file:line:column.
std::vector<std::pair<std::string, std::string>> read_config_file(
    const std::filesystem::path& file);

}  // namespace revisit::cli
