#pragma once

#include <string>

#include "revisit/recognition/ring/model.h"

namespace revisit::pipeline {

/// Returns FeatureExtractor::key of the model, without the precision. It identifies everything that
/// a scan's rings depend on: image, net and directions.
std::string ring_key(const RingModel& model);

}  // namespace revisit::pipeline
