#pragma once

#include <filesystem>

namespace revisit::test {

/// Writes a tiny KITTI data set (sequence 00) into `root`: `n` scans of a long room with pillars,
/// seen from a car that drives through it twice, with poses, calib and times.
void write_small_drive(const std::filesystem::path& root, int n = 24);

}  // namespace revisit::test
