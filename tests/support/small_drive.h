#pragma once

#include <filesystem>

namespace revisit::test {

/// Elevations [deg], evenly spaced downwards.
struct Beams {
  double top = 2, step = 3;
  int count = 8;
};

/// Writes sequence 00 of a tiny KITTI data set: `n` scans of a long room with pillars, in two
/// passes, with poses, calib and times.
void write_small_drive(const std::filesystem::path& root, int n = 24, const Beams& beams = {});

}  // namespace revisit::test
