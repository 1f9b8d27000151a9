#pragma once

#include <string>
#include <string_view>

namespace revisit::proto {

/// Fork of Caffe that defines an unsupported layer type, or "". Accepts the type name of any
/// generation or its parameter field: "PSROI_POOLING", "psroi_pooling_param".
std::string fork_of(std::string_view name);

}  // namespace revisit::proto
