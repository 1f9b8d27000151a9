#pragma once

#include <filesystem>

namespace revisit {

/// Creates missing parents, too. Throws Error with the folder and the reason.
void make_folder(const std::filesystem::path& folder);

}  // namespace revisit
