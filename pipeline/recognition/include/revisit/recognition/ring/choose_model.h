#pragma once

#include <string>
#include <vector>

#include "revisit/recognition/point_cloud.h"

namespace revisit::pipeline {

struct RingModelChoice {
  std::string sensor;  // of shipped_ring_models()
  std::string reason;  // for people
};

/// The shipped ring model for scans of one sensor: its own, when beams or field of view show a
/// sensor that has one; else the nearest. That must see what stands on the ground: among the models
/// whose image holds at least 88 % of what the widest one holds of it, the one whose upper edge and
/// number of beams (where they can be told apart) differ least. Tilt and mounting height do not
/// matter: scans are levelled. Before all comes the model that a map was made with, when it is a
/// shipped one: `made_by` is that of its identity. Throws UsageError without points.
RingModelChoice choose_ring_model(const std::vector<PointCloud>& scans,
                                  const std::string& made_by = "");

}  // namespace revisit::pipeline
