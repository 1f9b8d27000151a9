#pragma once

#include <cstdint>
#include <span>
#include <string>

namespace revisit::proto {

/// "1x3x227x227"; "()" for no axes.
std::string shape_text(std::span<const int64_t> shape);

}  // namespace revisit::proto
