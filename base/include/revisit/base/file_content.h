#pragma once

#include <cstddef>
#include <filesystem>
#include <string>

namespace revisit {

/// Reads the entire file. Throws InputError if it cannot be read or is not a regular file (a
/// folder, or a pipe, which could block forever).
std::string read_content(const std::filesystem::path& file);

/// Reads the first `most` bytes, or all if there are fewer. Throws like read_content().
std::string read_head(const std::filesystem::path& file, size_t most);

/// Reads the entire file; returns "" if read_content() would throw.
std::string content_if_any(const std::filesystem::path& file);

}  // namespace revisit
