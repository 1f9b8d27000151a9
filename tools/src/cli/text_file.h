#pragma once

#include <filesystem>
#include <string>

namespace revisit::cli {

/// The whole file. Throws InputError for what cannot be read and for what is no regular file (a
/// folder; a pipe, which could block for ever).
std::string read_text_file(const std::filesystem::path& file);

}  // namespace revisit::cli
