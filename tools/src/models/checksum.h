#pragma once

#include <filesystem>
#include <string>

namespace revisit::models {

/// A file's SHA-1 as lower-case hexadecimal: the sum that Caffe's models are published with, and
/// what identifies a network. A file that has not changed (path, size, number, times) is read once
/// in a process. Throws InputError when the file cannot be read.
std::string file_sha1(const std::filesystem::path& file);

}  // namespace revisit::models
