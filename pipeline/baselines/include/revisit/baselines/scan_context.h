#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "revisit/datasets/describe.h"
#include "revisit/recognition/point_cloud.h"

namespace revisit::pipeline {

/// Scan Context (G. Kim, A. Kim: Scan Context: Egocentric Spatial Descriptor for Place Recognition
/// within 3D Point Cloud Map, IROS 2018). docs/BASELINES.md says where the paper is silent.
struct ScanContextOptions {
  int rings = 20, sectors = 60;  // Nr, Ns
  double max_range = 80;         // [m], Lmax: points farther on the ground plane are left out
  double sensor_height = 2;      // [m], added to z so that the ground is about 0
  /// Candidates kept by their ring keys before contexts are compared (the paper: 10 or 50); 0: all.
  int64_t ring_key_candidates = 0;
};

/// Heights of the highest points of each bin, `[rings][sectors]` [m], 0 where there is none. Ring 0
/// is nearest. Sector 0 begins at azimuth 0 (x); azimuth grows counter-clockwise with the sector: a
/// yaw of the cloud by +360/sectors deg moves every column one to the right, around the edge.
void scan_context(const PointCloud& cloud, const ScanContextOptions& options,
                  std::span<float> context);

/// Occupied share of each ring `[rings]` (eq. 7 of the paper), which no yaw changes.
std::vector<float> ring_key(std::span<const float> context, const ScanContextOptions& options);

struct ContextDistance {
  double distance = 1;  // 0 (the same) .. 2; 1 when no two occupied columns meet
  int shift = 0;        // columns the first is moved to the left to meet the second so well
};
/// The least distance over all column shifts (eq. 5, 6): one minus the mean cosine of the columns
/// that are occupied in both. The lower shift on a tie.
ContextDistance context_distance(std::span<const float> a, std::span<const float> b,
                                 const ScanContextOptions& options);

/// Compared by 1 - distance; candidates that the ring keys leave out get -1. Throws UsageError.
FeatureExtractor scan_context_features(const ScanContextOptions& options = {});

}  // namespace revisit::pipeline
