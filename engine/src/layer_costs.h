#pragma once

#include "schedule.h"

namespace revisit::engine {

/// What each layer of a net is and costs under a schedule that is placed.
std::vector<LayerCost> layer_costs(const Net::Impl& net, const std::vector<Shape>& shapes,
                                   const Operations& operations, const Schedule& schedule);

}  // namespace revisit::engine
