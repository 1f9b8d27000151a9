#pragma once

#include <filesystem>

namespace revisit {

/// Makes the folder and those above it; good when it is there. Throws Error naming it and the
/// reason.
void make_folder(const std::filesystem::path& folder);

}  // namespace revisit
