#pragma once

#include <filesystem>
#include <string>

namespace revisit::models {

/// SHA-1 of a file in lower-case hexadecimal. Reads an unchanged file (path, size, inode, times)
/// once per process. Throws InputError if it cannot be read.
std::string file_sha1(const std::filesystem::path& file);

}  // namespace revisit::models
