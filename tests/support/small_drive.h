#pragma once

#include <filesystem>

namespace revisit::test {

/// Elevations of a sensor's beams [deg], evenly spaced downwards.
struct Beams {
  double top = 2, step = 3;
  int count = 8;
};

/// Writes a tiny KITTI data set (sequence 00) into `root`: `n` scans of a long room with pillars,
/// seen from a car that drives through it twice, with poses, calib and times.
void write_small_drive(const std::filesystem::path& root, int n = 24, const Beams& beams = {});

}  // namespace revisit::test
