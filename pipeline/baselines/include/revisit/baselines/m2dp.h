#pragma once

#include <span>
#include <vector>

#include "revisit/datasets/describe.h"
#include "revisit/recognition/point_cloud.h"

namespace revisit {

/// M2DP (L. He, X. Wang, H. Zhang: M2DP: A Novel 3D Point Cloud Descriptor and Its Application in
/// Loop Closure Detection, IROS 2016), with the sizes of the paper. docs/BASELINES.md lists choices
/// that the paper leaves open.
inline constexpr int kM2dpAzimuths = 4, kM2dpElevations = 16;  // p, q: directions of the planes
inline constexpr int kM2dpCircles = 8, kM2dpSectors = 16;      // l, t: bins of each plane
inline constexpr int kM2dpPlanes = kM2dpAzimuths * kM2dpElevations;
inline constexpr int kM2dpBins = kM2dpCircles * kM2dpSectors;
inline constexpr int kM2dpDim = kM2dpPlanes + kM2dpBins;  // 192

/// Signature matrix A [planes][bins]: fraction of the points in each bin of each plane. Points are
/// centered and rotated to their principal axes; those beyond 1 km are ignored. Throws InputError
/// if none is left.
std::vector<double> m2dp_signatures(const PointCloud& cloud);

/// Descriptor [192]: first left and right singular vectors of A, both non-negative.
void m2dp(const PointCloud& cloud, std::span<float> descriptor);

/// M2DP compared by cosine, which ranks like the Euclidean distance because all norms are sqrt(2).
FeatureExtractor m2dp_features();

}  // namespace revisit
