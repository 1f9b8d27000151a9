#pragma once

#include "revisit/datasets/describe.h"

namespace revisit {

// Hand-crafted descriptors of the paper's Table II, from PCL, with the paper's radii, compared by
// cosine. Points beyond 1 km or without a normal (fewer than 3 neighbors) are ignored; a scan
// without points gets the zero vector. Radii outside 1 mm .. 10 m, and builds without PCL, throw
// UsageError.

struct VfhOptions {
  double normal_radius = 0.03;  // [m]
};
/// Viewpoint Feature Histogram, 308 dimensions (Rusu, Bradski, Thibaux, Hsu: Fast 3D Recognition
/// and Pose Using the Viewpoint Feature Histogram, IROS 2010).
FeatureExtractor vfh_features(const VfhOptions& options = {});

struct GrsdOptions {
  double normal_radius = 0.05;  // [m]
  double radius = 0.1;          // [m], radius of the surface estimate and edge of the voxels
};
/// Global Radius-based Surface Descriptor, 21 dimensions (Marton, Pangercic, Blodow, Beetz:
/// Combined 2D-3D categorization and classification for multimodal perception systems, IJRR 2011).
FeatureExtractor grsd_features(const GrsdOptions& options = {});

/// Ensemble of Shape Functions, 640 dimensions (Wohlkinger, Vincze: Ensemble of shape functions for
/// 3D object classification, ROBIO 2011). Its random draws are seeded by the points, so that it is
/// deterministic. Describing throws InputError if the points span no triangle.
FeatureExtractor esf_features();

}  // namespace revisit
