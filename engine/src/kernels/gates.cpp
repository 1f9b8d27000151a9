#include "kernels/gates.h"

#include <algorithm>

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "kernels/gates.cpp"
#include <hwy/foreach_target.h>
// After foreach_target.h.
#include "kernels/blocked/simd_traits-inl.h"
#include "kernels/functions-inl.h"

HWY_BEFORE_NAMESPACE();
namespace revisit::engine::HWY_NAMESPACE {

/// As many units as a vector has lanes; the sums of each gate begin `step` after those before.
HWY_INLINE void update(float cont, const float* gates, int64_t step, float* c, float* h) {
  const Tag d;
  const Vector in = sigmoid(d, hn::LoadU(d, gates));
  const Vector out = sigmoid(d, hn::LoadU(d, gates + 2 * step));
  const Vector taken = hn::Mul(in, tanh(d, hn::LoadU(d, gates + 3 * step)));
  const Vector kept =
      cont == 0 ? hn::Zero(d) : hn::Mul(hn::Set(d, cont), sigmoid(d, hn::LoadU(d, gates + step)));
  const Vector state = hn::MulAdd(kept, hn::LoadU(d, c), taken);
  hn::StoreU(state, d, c);
  hn::StoreU(hn::Mul(out, tanh(d, state)), d, h);
}

void cell(int64_t width, float cont, const float* gates, float* c, float* h) {
  const int64_t whole = width / kVectorLanes * kVectorLanes, rest = width - whole;
  for (int64_t i = 0; i < whole; i += kVectorLanes) update(cont, gates + i, width, c + i, h + i);
  if (rest == 0) return;
  float last_gates[4 * kVectorLanes] = {}, last_c[kVectorLanes] = {}, last_h[kVectorLanes];
  for (int64_t gate = 0; gate < 4; ++gate)
    std::copy_n(gates + gate * width + whole, rest, last_gates + gate * kVectorLanes);
  std::copy_n(c + whole, rest, last_c);
  update(cont, last_gates, kVectorLanes, last_c, last_h);
  std::copy_n(last_c, rest, c + whole);
  std::copy_n(last_h, rest, h + whole);
}

}  // namespace revisit::engine::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace revisit::engine {

HWY_EXPORT(cell);

void lstm_cell(int64_t width, float cont, const float* gates, float* c, float* h) {
  HWY_DYNAMIC_DISPATCH(cell)(width, cont, gates, c, h);
}

}  // namespace revisit::engine
#endif  // HWY_ONCE
