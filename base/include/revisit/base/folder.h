#pragma once

#include <filesystem>

namespace revisit {

/// Makes the folder and those above it, where missing. Throws Error naming it and the reason.
void make_folder(const std::filesystem::path& folder);

}  // namespace revisit
