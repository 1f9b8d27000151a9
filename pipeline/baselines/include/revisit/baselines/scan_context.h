#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "revisit/datasets/describe.h"
#include "revisit/recognition/point_cloud.h"

namespace revisit {

/// G. Kim, A. Kim: Scan Context: Egocentric Spatial Descriptor for Place Recognition within 3D
/// Point Cloud Map, IROS 2018. docs/BASELINES.md lists choices that the paper leaves open.
struct ScanContextOptions {
  int rings = 20, sectors = 60;  // Nr, Ns
  double max_range = 80;         // [m], Lmax: maximum horizontal range
  double sensor_height = 2;      // [m], added to z so that the ground is near 0
  /// Candidates preselected by ring keys (the paper: 10 or 50); 0: all.
  int64_t ring_key_candidates = 0;
};

/// Maximum height per bin, `[rings][sectors]` [m], 0 in empty bins. Ring 0 is the innermost radial
/// bin. Sector 0 begins at azimuth 0 (x); azimuth increases counter-clockwise with the sector. A
/// yaw of the cloud by +360/sectors deg shifts all columns to the right by one, cyclically.
void scan_context(const PointCloud& cloud, const ScanContextOptions& options,
                  std::span<float> context);

/// Occupied fraction of each ring `[rings]` (eq. 7 of the paper); invariant to yaw.
std::vector<float> ring_key(std::span<const float> context, const ScanContextOptions& options);

struct ContextDistance {
  double distance = 1;  // 0 (equal) .. 2; 1 if no two occupied columns coincide
  int shift = 0;        // columns by which the first is shifted to the left
};
/// Minimum distance over all column shifts (eq. 5, 6): one minus the mean cosine of the columns
/// occupied in both. On a tie, the lowest shift.
ContextDistance context_distance(std::span<const float> a, std::span<const float> b,
                                 const ScanContextOptions& options);

/// Compared by 1 - distance; candidates that the ring keys exclude have similarity -1. Throws
/// UsageError for invalid options.
FeatureExtractor scan_context_features(const ScanContextOptions& options = {});

}  // namespace revisit
