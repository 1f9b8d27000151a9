#pragma once

#include <filesystem>

namespace revisit {

/// Creates the folder and missing parents. Throws Error with the folder and the reason.
void make_folder(const std::filesystem::path& folder);

}  // namespace revisit
