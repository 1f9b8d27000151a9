#pragma once

#include <cstddef>
#include <filesystem>
#include <string>

namespace revisit {

/// Throws InputError if the file is unreadable or not regular (a pipe could block forever).
std::string read_content(const std::filesystem::path& file);

/// Reads the first `most` bytes, or all if there are fewer. Throws like read_content().
std::string read_head(const std::filesystem::path& file, size_t most);

/// Returns "" if read_content() would throw.
std::string content_if_any(const std::filesystem::path& file);

}  // namespace revisit
