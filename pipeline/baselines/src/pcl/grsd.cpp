#include <pcl/features/feature.h>
#include <pcl/search/kdtree.h>

#include <algorithm>
#include <pcl/features/impl/feature.hpp>
#include <pcl/features/impl/grsd.hpp>
#include <pcl/features/impl/rsd.hpp>

#include "pcl/surface.h"
#include "revisit/base/error.h"
#include "revisit/baselines/pcl_features.h"

// pcl::GRSDEstimation allocates voxels for the whole extent, 3 GB for 160 m at 0.1 m, and reads out
// of bounds beyond 2^31. This is the same algorithm on the occupied voxels only.

namespace revisit {
namespace {

using Points = pcl::PointCloud<pcl::PointXYZ>;
using Grsd = pcl::GRSDEstimation<pcl::PointXYZ, pcl::Normal, pcl::GRSDSignature21>;

constexpr int kClasses = 5;  // without the class of empty voxels

struct Voxels {
  Points::Ptr centroids{new Points};
  std::vector<Voxel> places;
  std::unordered_map<uint64_t, size_t> rows;  // voxel key -> row in both
};

Voxels occupied_voxels(const Points& points, float edge) {
  Voxels voxels;
  std::vector<float> counts;
  for (const pcl::PointXYZ& point : points) {
    const Voxel place = voxel_of(point, edge);
    const auto [at, is_new] = voxels.rows.emplace(voxel_key(place), voxels.places.size());
    if (is_new) {
      voxels.places.push_back(place);
      voxels.centroids->push_back({0, 0, 0});
      counts.push_back(0);
    }
    (*voxels.centroids)[at->second].getVector3fMap() += point.getVector3fMap();
    ++counts[at->second];
  }
  for (size_t i = 0; i < counts.size(); ++i) (*voxels.centroids)[i].getVector3fMap() /= counts[i];
  return voxels;
}

std::vector<int> surface_classes(const Voxels& voxels, const Surface& surface, double radius) {
  pcl::RSDEstimation<pcl::PointXYZ, pcl::Normal, pcl::PrincipalRadiiRSD> estimation;
  estimation.setInputCloud(voxels.centroids);
  estimation.setSearchSurface(surface.points);
  estimation.setInputNormals(surface.normals);
  estimation.setRadiusSearch(radius);
  pcl::PointCloud<pcl::PrincipalRadiiRSD> radii;
  estimation.compute(radii);
  std::vector<int> classes;
  for (const pcl::PrincipalRadiiRSD& r : radii)
    classes.push_back(Grsd::getSimpleType(r.r_min, r.r_max));
  return classes;
}

void count_transitions(const Voxels& voxels, const std::vector<int>& classes,
                       std::span<float> feature) {
  std::array<std::array<int, kClasses + 1>, kClasses + 1> transitions{};
  for (size_t i = 0; i < classes.size(); ++i)
    for (int dx = -1; dx <= 1; ++dx)
      for (int dy = -1; dy <= 1; ++dy)
        for (int dz = -1; dz <= 1; ++dz) {
          if (dx == 0 && dy == 0 && dz == 0) continue;
          const Voxel& place = voxels.places[i];
          const auto at =
              voxels.rows.find(voxel_key({place[0] + dx, place[1] + dy, place[2] + dz}));
          const int neighbor = at == voxels.rows.end() ? kClasses : classes[at->second];
          ++transitions[static_cast<size_t>(classes[i])][static_cast<size_t>(neighbor)];
        }
  auto out = feature.begin();
  for (size_t a = 0; a <= kClasses; ++a)
    for (size_t b = a; b <= kClasses; ++b)
      *out++ = static_cast<float>(transitions[a][b] + transitions[b][a]);
}

}  // namespace

FeatureExtractor grsd_features(const GrsdOptions& options) {
  check_radius("GRSD, normals", options.normal_radius);
  check_radius("GRSD", options.radius);
  FeatureExtractor extractor;
  extractor.name = "grsd";
  extractor.dim = pcl::GRSDSignature21::descriptorSize();
  extractor.key = str("grsd normals ", options.normal_radius, " radius ", options.radius);
  extractor.make = [options]() -> FeatureFunction<PointCloud> {
    return [options](const PointCloud& cloud, std::span<float> feature) {
      std::fill(feature.begin(), feature.end(), 0.0F);
      const Surface surface =
          surface_of(cloud, options.normal_radius, std::max(options.normal_radius, options.radius));
      if (surface.points->empty()) return;
      const Voxels voxels = occupied_voxels(*surface.points, static_cast<float>(options.radius));
      count_transitions(voxels, surface_classes(voxels, surface, options.radius), feature);
    };
  };
  return extractor;
}

}  // namespace revisit
