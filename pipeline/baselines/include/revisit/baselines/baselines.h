#pragma once

#include <cstdint>
#include <filesystem>
#include <span>
#include <vector>

#include "revisit/datasets/describe.h"

namespace revisit {

// The methods that the paper compares with, and others. docs/reference/BASELINES.md lists choices
// that their sources leave open.

/// G. Kim, A. Kim: Scan Context: Egocentric Spatial Descriptor for Place Recognition within 3D
/// Point Cloud Map, IROS 2018.
struct ScanContextOptions {
  int rings = 20, sectors = 60;  ///< radial bins and azimuth sectors: Nr, Ns
  double max_range = 80;         ///< [m], Lmax: maximum horizontal range
  double sensor_height = 2;      ///< [m], added to z so that the ground is near 0
  /// Candidates preselected by ring keys (the paper: 10 or 50); 0: all.
  int64_t candidates = 0;
};

/// Maximum height per bin, `[rings][sectors]` [m], 0 in empty bins. Ring 0 is the innermost radial
/// bin. Sector 0 begins at azimuth 0 (x); azimuth increases counter-clockwise with the sector. A
/// yaw of the cloud by +360/sectors deg shifts all columns to the right by one, cyclically.
void scan_context(const PointCloud& cloud, const ScanContextOptions& options,
                  std::span<float> context);

/// Occupied fraction of each ring `[rings]` (eq. 7 of the paper); invariant to yaw.
std::vector<float> ring_key(std::span<const float> context, const ScanContextOptions& options);

/// Compared by 1 - the minimum distance over all column shifts (eq. 5, 6): one minus the mean
/// cosine of the columns occupied in both, 0 (equal) to 2; 1 if no two occupied columns coincide.
/// Candidates that the ring keys exclude have similarity -1. Throws UsageError for invalid options.
FeatureExtractor scan_context_features(const ScanContextOptions& options = {});

/// M2DP (L. He, X. Wang, H. Zhang: M2DP: A Novel 3D Point Cloud Descriptor and Its Application in
/// Loop Closure Detection, IROS 2016), 192 dimensions, compared by cosine, which ranks like the
/// Euclidean distance because all norms are sqrt(2). Points are centered and rotated to their
/// principal axes; those beyond 1 km are ignored. Describing throws InputError if none is left.
FeatureExtractor m2dp_features();

// Descriptors of the paper's Table II, from PCL, with the paper's radii [m], compared by cosine.
// Points beyond 1 km or without a normal (fewer than 3 neighbors) are ignored; a scan without
// points gets the zero vector. Radii outside 1 mm .. 10 m, and builds without PCL, throw
// UsageError.

/// Viewpoint Feature Histogram, 308 dimensions (Rusu, Bradski, Thibaux, Hsu: Fast 3D Recognition
/// and Pose Using the Viewpoint Feature Histogram, IROS 2010).
FeatureExtractor vfh_features(double normal_radius = 0.03);

/// Global Radius-based Surface Descriptor, 21 dimensions (Marton, Pangercic, Blodow, Beetz:
/// Combined 2D-3D categorization and classification for multimodal perception systems, IJRR 2011).
/// `radius`: of the surface estimate, and edge of the voxels.
FeatureExtractor grsd_features(double normal_radius = 0.05, double radius = 0.1);

/// Ensemble of Shape Functions, 640 dimensions (Wohlkinger, Vincze: Ensemble of shape functions for
/// 3D object classification, ROBIO 2011). Its random draws are seeded by the points, so that it is
/// deterministic. Describing throws InputError if the points span no triangle.
FeatureExtractor esf_features();

// FAB-MAP (M. Cummins, P. Newman: FAB-MAP: Probabilistic Localization and Mapping in the Space of
// Appearance, IJRR 27(6), 2008). Builds without OpenCV throw UsageError.

/// 400 words of a camera image, compared by the probability of the same place. They are trained on
/// `images`, those of camera_images(), or loaded from an equal earlier result in `folder`.
/// `sampled`: the likelihood of a new place comes from the training images, which must show other
/// places. The result does not depend on the number of threads. Throws InputError if images cannot
/// be read or show too little, Error if the folder cannot be written, and Interrupted.
FeatureExtractor fabmap_features(const Dataset& images, bool sampled,
                                 const std::filesystem::path& folder, int threads = 1,
                                 const Observer& observer = {});

}  // namespace revisit
