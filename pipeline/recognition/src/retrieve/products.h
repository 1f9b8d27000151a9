#pragma once

#include <span>

namespace revisit {

/// `rows` is [products.size()][key.size()].
void products_of_rows(std::span<const float> key, const float* rows, std::span<float> products);

}  // namespace revisit
