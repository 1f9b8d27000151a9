#pragma once

#include "schedule.h"

namespace revisit::engine {

/// Description and cost of each layer of a net for a placed schedule.
std::vector<LayerCost> layer_costs(const Net::Impl& net, const std::vector<Shape>& shapes,
                                   const Operations& operations, const Schedule& schedule);

}  // namespace revisit::engine
