#pragma once

#include <cstdint>

namespace revisit::engine {

/// One step of an LSTM's stream of `width` units, from the sums of its gates i, f, o, g:
/// c = cont sigmoid(f) c + sigmoid(i) tanh(g);  h = sigmoid(o) tanh(c). Without `cont` the old cell
/// counts for nothing, whatever its gate says.
void lstm_cell(int64_t width, float cont, const float* gates, float* c, float* h);

}  // namespace revisit::engine
