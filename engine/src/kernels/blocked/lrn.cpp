#include "kernels/blocked/lrn.h"

#include "kernels/blocked/blocked_pieces.h"
#include "kernels/blocked/dispatch.h"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "kernels/blocked/lrn.cpp"
#include <hwy/foreach_target.h>
// After foreach_target.h.
#include "kernels/blocked/lrn-inl.h"

HWY_BEFORE_NAMESPACE();
namespace revisit::engine::HWY_NAMESPACE {

template <class T>
void normalise_all(const LrnProblem& p, const T* input, T* output, float* scratch) {
  constexpr int64_t kPixels = 256;  // of an item: enough to be worth clearing the margins
  const LrnSquares s(p);
  const int64_t blocks = channel_blocks(p.c), pixels = p.h * p.w, step = pixels * kLanes;
  const int64_t pieces = (pixels + kPixels - 1) / kPixels;
  parallel_for(p.n * pieces, p.threads, [&](int64_t item, int thread) HWY_ATTR {
    float* const squares = scratch + thread * s.floats();
    clear_margins(s, squares);
    const int64_t first = item % pieces * kPixels, last = std::min(first + kPixels, pixels);
    const int64_t image = item / pieces * blocks * step;
    for (int64_t i = first; i < last; i += s.pixels) {
      const int64_t at = image + i * kLanes, count = std::min(s.pixels, last - i);
      normalise(
          p, s,
          LrnTile<T, T>{input + at, step, output + at, step, count, s.pixels * kLanes, squares});
    }
    T* const tail = output + image + (blocks - 1) * step + first * kLanes;
    clear_tail_lanes(p.c, blocks - 1, last - first, tail);
  });
}

void lrn(const LrnProblem& p, const void* in, void* out, float* scratch) {
  with_type(p.values, [&](auto type) {
    using T = decltype(type);
    normalise_all(p, static_cast<const T*>(in), static_cast<T*>(out), scratch);
  });
}

}  // namespace revisit::engine::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace revisit::engine {

HWY_EXPORT(lrn);

int64_t blocked_lrn_scratch_floats(const LrnProblem& p) {
  return p.threads * LrnSquares(p).floats();
}

void blocked_lrn(const LrnProblem& p, const void* input, void* output, float* scratch) {
  REVISIT_DISPATCH(lrn, instructions_for(p.values))(p, input, output, scratch);
}

}  // namespace revisit::engine
#endif  // HWY_ONCE
