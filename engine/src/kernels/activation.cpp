#include "kernels/epilogue.h"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "kernels/activation.cpp"
#include <hwy/foreach_target.h>
// After foreach_target.h.
#include "kernels/blocked/epilogue-inl.h"

HWY_BEFORE_NAMESPACE();
namespace revisit::engine::HWY_NAMESPACE {

HWY_ALIGN constexpr float kNoSlopes[kLanes] = {};

/// Computes the last values as part of a full block.
void activate_nchw(const Epilogue& epilogue, int64_t count, const float* in, float* out) {
  int64_t i = 0;
  for (; i + kLanes <= count; i += kLanes) {
    Block x[1];
    for (int v = 0; v < kVectors; ++v) x[0].v[v] = hn::LoadU(Tag(), in + i + v * kVectorLanes);
    activate(epilogue, kNoSlopes, x);
    for (int v = 0; v < kVectors; ++v) hn::StoreU(x[0].v[v], Tag(), out + i + v * kVectorLanes);
  }
  if (i == count) return;
  HWY_ALIGN float last[kLanes] = {};
  std::copy(in + i, in + count, last);
  Block x[] = {load_block(last)};
  activate(epilogue, kNoSlopes, x);
  store_block(x[0], last);
  std::copy_n(last, count - i, out + i);
}

}  // namespace revisit::engine::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace revisit::engine {

HWY_EXPORT(activate_nchw);

void activate(const Epilogue& epilogue, int64_t count, const float* in, float* out) {
  HWY_DYNAMIC_DISPATCH(activate_nchw)(epilogue, count, in, out);
}

}  // namespace revisit::engine
#endif
