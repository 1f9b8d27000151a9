#pragma once

#include <string>

#include "revisit/recognition/ring/model.h"

namespace revisit {

/// FeatureExtractor::key without the precision; identifies image, net and directions.
std::string ring_key(const RingModel& model);

}  // namespace revisit
