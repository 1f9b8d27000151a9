#pragma once

#include <memory>

#include "layer.h"

namespace revisit::engine {

/// Normalisation across channels and then maximum pooling, as one.
std::unique_ptr<Layer> make_lrn_max_pooling(const LrnMaxPooling& problem);

}  // namespace revisit::engine
