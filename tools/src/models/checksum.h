#pragma once

#include <filesystem>
#include <string>

namespace revisit::models {

/// A file's checksum as lower-case hexadecimal. `algorithm` is a name OpenSSL knows: "sha1",
/// "sha256". Throws InputError when the file cannot be read.
std::string file_checksum(const std::filesystem::path& file, const char* algorithm);

}  // namespace revisit::models
