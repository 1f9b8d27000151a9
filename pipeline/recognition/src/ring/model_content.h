#pragma once

#include <string>

#include "revisit/recognition/ring/model.h"

namespace revisit::pipeline {

/// The bytes of all that a scan's rings depend on: image, net and directions, not what was learnt
/// about rings.
std::string extraction_content(const RingModel& model);

}  // namespace revisit::pipeline
