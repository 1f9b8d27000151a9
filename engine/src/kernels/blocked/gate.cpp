#include "kernels/blocked/gate.h"

#include "kernels/blocked/blocked_pieces.h"
#include "kernels/blocked/dispatch.h"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "kernels/blocked/gate.cpp"
#include <hwy/foreach_target.h>
// After foreach_target.h.
#include "kernels/blocked/epilogue-inl.h"

HWY_BEFORE_NAMESPACE();
namespace revisit::engine::HWY_NAMESPACE {
namespace {

/// The factors of the channels of a block, zeros beyond the last channel.
HWY_INLINE Block factors_of(const BlockedSize& size, const float* factors, int64_t plane) {
  const int64_t image = plane / channel_blocks(size.c);
  const int64_t channel = plane % channel_blocks(size.c) * kLanes;
  HWY_ALIGN float padded[kLanes] = {};
  std::copy_n(factors + image * size.c + channel, std::min(size.c - channel, kLanes), padded);
  return load_block(padded);
}

/// factor * x + addend; the addend alone where `zero_hides` and the factor is 0.
HWY_INLINE Block gated(const Block& factors, const Block& x, const Block& addend, bool zero_hides) {
  Block r = mul_add(factors, x, addend);
  if (!zero_hides) return r;
  REVISIT_UNROLL
  for (int i = 0; i < kVectors; ++i)
    r.v[i] = hn::IfThenElse(hn::Eq(factors.v[i], hn::Zero(Tag())), addend.v[i], r.v[i]);
  return r;
}

template <class T>
void gate_all(const BlockedSize& size, const BlockedGate& gate, const T* input, T* output) {
  const auto* const addend = static_cast<const T*>(gate.addend);
  for_each_piece(size, [&](int64_t block, int64_t begin, int64_t end) HWY_ATTR {
    const Block factors = factors_of(size, gate.factors, begin / kLanes / size.pixels);
    const float* slopes = gate.epilogue.slopes ? gate.epilogue.slopes + block * kLanes : nullptr;
    for (int64_t i = begin; i < end; i += kLanes) {
      const Block x = load_block(input + i);
      Block y[] = {addend ? gated(factors, x, load_block(addend + i), gate.zero_hides)
                          : factors * x};
      activate(gate.epilogue, slopes, y);
      store_block(y[0], output + i);
    }
    clear_tail_lanes(size.c, block, (end - begin) / kLanes, output + begin);
  });
}

}  // namespace

void gate_values(const BlockedSize& size, const BlockedGate& gate, const void* input,
                 void* output) {
  with_type(size.values, [&](auto type) {
    using T = decltype(type);
    gate_all(size, gate, static_cast<const T*>(input), static_cast<T*>(output));
  });
}

}  // namespace revisit::engine::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace revisit::engine {

HWY_EXPORT(gate_values);

void blocked_gate(const BlockedSize& size, const BlockedGate& gate, const void* input,
                  void* output) {
  REVISIT_DISPATCH(gate_values, instructions_for(size.values))(size, gate, input, output);
}

}  // namespace revisit::engine
#endif  // HWY_ONCE
