#include <pcl/features/vfh.h>
#include <pcl/search/kdtree.h>

#include <algorithm>

#include "baselines/pcl/surface.h"
#include "revisit/pipeline/pcl_features.h"
#include "revisit/proto/error.h"

namespace revisit::pipeline {

FeatureExtractor vfh_features(const VfhOptions& options) {
  check_radius("VFH, normals", options.normal_radius);
  FeatureExtractor extractor;
  extractor.name = "vfh";
  extractor.dim = pcl::VFHSignature308::descriptorSize();
  extractor.key = str("vfh normals ", options.normal_radius);
  extractor.make = [options]() -> FeatureFunction<PointCloud> {
    return [options](const PointCloud& cloud, std::span<float> feature) {
      std::fill(feature.begin(), feature.end(), 0.0F);
      const Surface surface = surface_of(cloud, options.normal_radius, options.normal_radius);
      if (surface.points->size() < 2) return;
      pcl::VFHEstimation<pcl::PointXYZ, pcl::Normal> estimation;
      estimation.setInputCloud(surface.points);
      estimation.setInputNormals(surface.normals);
      pcl::PointCloud<pcl::VFHSignature308> signature;
      estimation.compute(signature);
      std::copy_n(signature[0].histogram, feature.size(), feature.begin());
    };
  };
  return extractor;
}

}  // namespace revisit::pipeline
