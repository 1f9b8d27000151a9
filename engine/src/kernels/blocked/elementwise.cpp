#include "kernels/blocked/kernels.h"
#include "kernels/blocked/partition.h"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "kernels/blocked/elementwise.cpp"
#include <hwy/foreach_target.h>
// After foreach_target.h.
#include "kernels/blocked/epilogue-inl.h"

HWY_BEFORE_NAMESPACE();
namespace revisit::engine::HWY_NAMESPACE {
namespace {

/// Computes activation(compute(offset of a block, its first channel)).
template <class T, class Compute>
HWY_INLINE void for_each_block(const BlockedSize& size, const Epilogue& epilogue, T* output,
                               const Compute& compute) {
  for_each_piece(size, [&](int64_t block, int64_t begin, int64_t end) HWY_ATTR {
    const int64_t channel = block * kLanes;
    const float* slopes = epilogue.slopes ? epilogue.slopes + channel : nullptr;
    for (int64_t i = begin; i < end; i += kLanes) {
      Block x[] = {compute(i, channel)};
      activate(epilogue, slopes, x);
      store_block(x[0], output + i);
    }
    clear_tail_lanes(size.c, block, (end - begin) / kLanes, output + begin);
  });
}

/// a if a > b, else b; so b if either is NaN.
HWY_INLINE Block greater(const Block& a, Block b) {
  REVISIT_UNROLL
  for (int i = 0; i < kVectors; ++i)
    b.v[i] = hn::IfThenElse(hn::Gt(a.v[i], b.v[i]), a.v[i], b.v[i]);
  return b;
}

template <class T>
void activate_all(const BlockedSize& size, const Epilogue& epilogue, const T* input, T* output) {
  for_each_block(size, epilogue, output,
                 [&](int64_t i, int64_t) HWY_ATTR { return load_block(input + i); });
}

template <class T>
void scale_all(const BlockedSize& size, const float* scale, const float* shift,
               const Epilogue& epilogue, const T* input, T* output) {
  for_each_block(size, epilogue, output, [&](int64_t i, int64_t channel) HWY_ATTR {
    return mul_add(load_block(input + i), load_block(scale + channel), load_block(shift + channel));
  });
}

template <class T>
void combine(const BlockedSize& size, const BlockedEltwise& e,
             std::span<const float* const> operands, T* output) {
  const auto input = [&](size_t k) HWY_ATTR { return reinterpret_cast<const T*>(operands[k]); };
  switch (e.operation) {
    case BlockedEltwise::Operation::kSum:
      for_each_block(size, e.epilogue, output, [&](int64_t i, int64_t) HWY_ATTR {
        Block sum = zero_block();
        for (size_t k = 0; k < operands.size(); ++k)
          if (e.coefficients[k] != 0)
            sum = mul_add(hn::Set(Tag(), e.coefficients[k]), load_block(input(k) + i), sum);
        return sum;
      });
      break;
    case BlockedEltwise::Operation::kProduct:
      for_each_block(size, e.epilogue, output, [&](int64_t i, int64_t) HWY_ATTR {
        Block product = load_block(input(0) + i);
        for (size_t k = 1; k < operands.size(); ++k) product = product * load_block(input(k) + i);
        return product;
      });
      break;
    case BlockedEltwise::Operation::kMaximum:
      // Caffe's NaN rule: NaN in the second input wins over the first; later NaNs are ignored.
      for_each_block(size, e.epilogue, output, [&](int64_t i, int64_t) HWY_ATTR {
        Block best = greater(load_block(input(0) + i), load_block(input(1) + i));
        for (size_t k = 2; k < operands.size(); ++k) best = greater(load_block(input(k) + i), best);
        return best;
      });
      break;
  }
}

HWY_INLINE Block factors_of(const BlockedSize& size, const float* factors, int64_t plane) {
  const int64_t image = plane / channel_blocks(size.c);
  const int64_t channel = plane % channel_blocks(size.c) * kLanes;
  HWY_ALIGN float padded[kLanes] = {};
  std::copy_n(factors + image * size.c + channel, std::min(size.c - channel, kLanes), padded);
  return load_block(padded);
}

/// factor * x + addend; only the addend if `zero_hides` and the factor is 0.
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

void activation(const BlockedSize& size, const Epilogue& epilogue, const void* in, void* out) {
  with_type(size.values, [&](auto type) {
    using T = decltype(type);
    activate_all(size, epilogue, static_cast<const T*>(in), static_cast<T*>(out));
  });
}

void scale_shift(const BlockedSize& size, const float* scale, const float* shift,
                 const Epilogue& epilogue, const void* in, void* out) {
  with_type(size.values, [&](auto type) {
    using T = decltype(type);
    scale_all(size, scale, shift, epilogue, static_cast<const T*>(in), static_cast<T*>(out));
  });
}

void eltwise(const BlockedSize& size, const BlockedEltwise& e, std::span<const float* const> inputs,
             void* output) {
  with_type(size.values,
            [&](auto type) { combine(size, e, inputs, static_cast<decltype(type)*>(output)); });
}

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

HWY_EXPORT(activation);
HWY_EXPORT(scale_shift);
HWY_EXPORT(eltwise);
HWY_EXPORT(gate_values);

void blocked_activation(const BlockedSize& size, const Epilogue& epilogue, const void* input,
                        void* output) {
  REVISIT_DISPATCH(activation, instructions_for(size.values))(size, epilogue, input, output);
}

void blocked_scale(const BlockedSize& size, const float* scale, const float* shift,
                   const Epilogue& epilogue, const void* input, void* output) {
  REVISIT_DISPATCH(scale_shift, instructions_for(size.values))
  (size, scale, shift, epilogue, input, output);
}

void blocked_eltwise(const BlockedSize& size, const BlockedEltwise& eltwise,
                     std::span<const float* const> inputs, void* output) {
  REVISIT_DISPATCH(eltwise, instructions_for(size.values))(size, eltwise, inputs, output);
}

void blocked_gate(const BlockedSize& size, const BlockedGate& gate, const void* input,
                  void* output) {
  REVISIT_DISPATCH(gate_values, instructions_for(size.values))(size, gate, input, output);
}

}  // namespace revisit::engine
#endif
