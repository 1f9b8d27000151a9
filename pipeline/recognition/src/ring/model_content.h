#pragma once

#include <string>

#include "revisit/recognition/ring/model.h"

namespace revisit::pipeline {

/// The bytes that a scan's rings depend on: image, net and directions.
std::string extraction_content(const RingModel& model);

}  // namespace revisit::pipeline
