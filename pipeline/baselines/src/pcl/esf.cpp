// PCL's ESF draws triangles with rand(), seeded with the time, and is not repeatable. Its template
// is therefore instantiated here for another point type, with another generator.
#define PCL_NO_PRECOMPILE
#include <pcl/common/distances.h>
#include <pcl/common/transforms.h>
#include <pcl/features/feature.h>

#include <algorithm>
#include <bit>
#include <cmath>
#include <optional>
#include <random>

#include "point_features.h"
#include "revisit/base/error.h"
#include "revisit/base/hash.h"
#include "revisit/baselines/baselines.h"

namespace revisit {
namespace {

/// Limited in number, because PCL repeats draws forever if all points are collinear.
class Draws {
 public:
  explicit Draws(uint64_t seed) : generator_(seed) {}
  int next() {
    constexpr int64_t kMost = 200 * int64_t{60'000};  // 60,000 if no draw is rejected
    if (++drawn_ > kMost) throw InputError("ESF: the points are nearly collinear");
    return static_cast<int>(generator_() >> 33);
  }

 private:
  std::mt19937_64 generator_;
  int64_t drawn_ = 0;
};

thread_local std::optional<Draws> draws_of_this_scan;

int seeded_rand() {
  return draws_of_this_scan->next();
}

/// Clamps a cosine to 1: PCL would cast the NaN of its angle to int, which is undefined behavior.
float rounded(float value) {
  return std::isnan(value) ? -1.0F : pcl_round(value);
}

}  // namespace
}  // namespace revisit

#define rand revisit::seeded_rand
#define srand(seed) static_cast<void>(seed)
#define pcl_round(value) revisit::rounded(value)
#include <pcl/features/esf.h>
#undef rand
#undef srand
#undef pcl_round

namespace revisit {
namespace {

struct EsfPoint : pcl::PointXYZ {};

}  // namespace
}  // namespace revisit

/// Skips the search tree, which needs FLANN; the functions called below use none.
template <>
bool pcl::Feature<revisit::EsfPoint, pcl::ESFSignature640>::initCompute() {
  return false;
}

namespace revisit {
namespace {

using Points = pcl::PointCloud<EsfPoint>;

uint64_t seed_of(const Points& points) {
  uint64_t hash = kFnv1aStart;
  for (const EsfPoint& point : points)
    for (const float value : {point.x, point.y, point.z})
      hash = fnv1a(hash, std::bit_cast<uint32_t>(value));
  return hash;
}

class SeededEsf : private pcl::ESFEstimation<EsfPoint> {
 public:
  void describe(Points& points, std::span<float> feature) {
    scale_into_grid(points);
    draws_of_this_scan.emplace(seed_of(points));
    std::vector<float> histogram;
    voxelize9(points);
    try {
      computeESF(points, histogram);
    } catch (...) {
      cleanup9(points);
      throw;
    }
    cleanup9(points);
    std::copy(histogram.begin(), histogram.end(), feature.begin());
  }

 private:
  /// Puts the farthest point just inside the voxel grid's sphere, so that rounding stays in bounds.
  static void scale_into_grid(Points& points) {
    Eigen::Vector3d sum = Eigen::Vector3d::Zero();
    for (const EsfPoint& point : points) sum += point.getVector3fMap().cast<double>();
    const Eigen::Vector3f centroid = (sum / static_cast<double>(points.size())).cast<float>();
    float farthest = 0;
    for (EsfPoint& point : points) {
      point.getVector3fMap() -= centroid;
      farthest = std::max(farthest, point.getVector3fMap().norm());
    }
    if (!(farthest > 1e-6F)) throw InputError("ESF: all points are equal");
    constexpr float kHalfGrid = 32 * (1 - 1e-5F);
    for (EsfPoint& point : points) point.getVector3fMap() *= kHalfGrid / farthest;
  }
};

}  // namespace

FeatureExtractor esf_features() {
  const auto make = []() -> FeatureFunction<PointCloud> {
    return
        [esf = std::make_shared<SeededEsf>()](const PointCloud& cloud, std::span<float> feature) {
          const Points::Ptr points = to_pcl<Points>(cloud);
          if (points->size() < 3)
            throw InputError("ESF: expected at least 3 points, found ", points->size());
          esf->describe(*points, feature);
        };
  };
  const int64_t dim = pcl::ESFSignature640::descriptorSize();
  return {.name = "esf", .key = "esf", .dim = dim, .make = make};
}

}  // namespace revisit
