#pragma once

#include <cstddef>
#include <filesystem>
#include <string>

namespace revisit {

/// The whole file. Throws InputError for what cannot be read or is not a regular file (a
/// folder; a pipe, which could block for ever).
std::string read_content(const std::filesystem::path& file);

/// Its first `most` bytes, or all when it has fewer. Throws as read_content() does.
std::string read_head(const std::filesystem::path& file, size_t most);

/// The whole file, or "" for what read_content() refuses.
std::string content_if_any(const std::filesystem::path& file);

}  // namespace revisit
