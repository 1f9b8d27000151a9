#pragma once

#include <cstdint>

#include "kernels/epilogue.h"

namespace revisit::engine {

/// The activation of `epilogue`, of any kind but kPrelu, on plain values. `out` may be `in`. What
/// becomes of a number does not depend on where it stands.
void activate(const Epilogue& epilogue, int64_t count, const float* in, float* out);

}  // namespace revisit::engine
