#pragma once

#include <filesystem>
#include <string>

namespace revisit::models {

/// A file's SHA-1 in lower-case hexadecimal, which identifies a network. An unchanged file (path,
/// size, number, times) is read once in a process. Throws InputError if it cannot be read.
std::string file_sha1(const std::filesystem::path& file);

}  // namespace revisit::models
