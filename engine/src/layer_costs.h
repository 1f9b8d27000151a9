#pragma once

#include "schedule.h"

namespace revisit::engine {

std::vector<LayerCost> layer_costs(const Net::Impl& net, const std::vector<Shape>& shapes,
                                   const Operations& operations, const Schedule& schedule);

}  // namespace revisit::engine
