#pragma once

#include <filesystem>
#include <string>
#include <utility>
#include <vector>

namespace revisit::cli {

/// Reads a YAML file of option names and values (a list repeats the option), for Parser::config().
/// Throws InputError with file:line:column for what is not a flat map of scalars.
std::vector<std::pair<std::string, std::string>> read_config_file(
    const std::filesystem::path& file);

}  // namespace revisit::cli
