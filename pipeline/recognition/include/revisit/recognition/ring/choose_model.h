#pragma once

#include <string>
#include <vector>

#include "revisit/recognition/point_cloud.h"

namespace revisit {

struct RingModelChoice {
  std::string sensor;  // one of shipped_ring_models()
  std::string reason;  // human-readable
};

/// Chooses the shipped ring model for scans of one sensor, in this order:
/// - the model that a map was built with, if it is a shipped one (`made_by`, the
///   FeatureExtractor::key in the map's configuration fingerprint);
/// - the sensor's own model, if beams or field of view identify the sensor;
/// - the nearest model. Candidates hold at least 88 % of the non-ground points that the best one
///   holds. Among them it has the smallest difference in upper edge and number of beams (if beams
///   can be separated).
/// Tilt and mounting height do not matter, because scans are gravity-aligned. Throws UsageError
/// without points.
RingModelChoice choose_ring_model(const std::vector<PointCloud>& scans,
                                  const std::string& made_by = "");

}  // namespace revisit
