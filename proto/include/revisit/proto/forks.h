#pragma once

#include <string>
#include <string_view>

namespace revisit::proto {

/// The fork of Caffe that has a layer type which is not here, or "". The name is that of the type
/// in any generation or of its parameters: "PSROIPooling", "PSROI_POOLING", "psroi_pooling_param".
std::string fork_that_has(std::string_view name);

}  // namespace revisit::proto
