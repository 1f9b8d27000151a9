#pragma once

#include <algorithm>
#include <cstdint>
#include <cstring>
#include <functional>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "revisit/base/error.h"
#include "revisit/recognition/feature.h"

namespace revisit::test {

inline constexpr int64_t kNumbers = 6;

/// The first six coordinates. The projection subtracts the mean of the training entries.
inline FeatureExtractor coordinates(std::optional<double> same_place = {}) {
  const auto projection_with = [same_place](std::vector<float> mean) {
    Projection projection;
    projection.dim = kNumbers;
    projection.describe = [mean](std::span<const float> feature, std::span<float> descriptor) {
      std::ranges::transform(feature, mean, descriptor.begin(), std::minus());
    };
    projection.comparison.same_place = same_place;
    projection.comparison.relative_yaw = [](std::span<const float> a, std::span<const float> b) {
      return static_cast<double>(b[0] - a[0]);
    };
    projection.content.assign(reinterpret_cast<const char*>(mean.data()),
                              mean.size() * sizeof(float));
    return projection;
  };
  FeatureExtractor extractor;
  extractor.name = "coordinates";
  extractor.key = "coordinates 1";
  extractor.dim = kNumbers;
  extractor.comparison.same_place = same_place;
  extractor.make = []() -> FeatureFunction<PointCloud> {
    return [](const PointCloud& cloud, std::span<float> feature) {
      if (cloud.points.size() < 2) throw InputError("fewer than two points");
      for (size_t i = 0; i < 2; ++i) {
        feature[3 * i] = cloud.points[i].x;
        feature[3 * i + 1] = cloud.points[i].y;
        feature[3 * i + 2] = cloud.points[i].z;
      }
    };
  };
  extractor.fit_projection = [projection_with](const Rows& features,
                                               std::span<const int64_t> rows) {
    std::vector<float> mean(kNumbers);
    for (const int64_t row : rows)
      for (size_t i = 0; i < mean.size(); ++i)
        mean[i] += features.row(row)[i] / static_cast<float>(rows.size());
    return projection_with(mean);
  };
  extractor.open_projection = [projection_with](const std::string& content) {
    std::vector<float> mean(kNumbers);
    std::memcpy(mean.data(), content.data(), content.size());
    return projection_with(mean);
  };
  return extractor;
}

}  // namespace revisit::test
