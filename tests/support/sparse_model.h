#pragma once

#include <filesystem>

namespace revisit::test {

/// Writes a caffemodel with AlexNet's layers and blob shapes (61 million zeros, 244 MB). The file
/// is sparse: the zeros take no room on disk, but reading them reads them.
void write_sparse_alexnet(const std::filesystem::path& file);

}  // namespace revisit::test
