#include "kernels/blocked/elementwise.h"

#include "kernels/blocked/blocked_pieces.h"
#include "kernels/blocked/dispatch.h"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "kernels/blocked/elementwise.cpp"
#include <hwy/foreach_target.h>
// After foreach_target.h.
#include "kernels/blocked/epilogue-inl.h"

HWY_BEFORE_NAMESPACE();
namespace revisit::engine::HWY_NAMESPACE {
namespace {

/// output = activation(compute(place, channel)) where `place` counts numbers of the value and
/// `channel` is the first of the block there.
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

/// a where a > b, else b: of a NaN and another number, b.
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
      // As in Caffe: of the first two a NaN in the second wins, then NaN neither wins nor loses.
      for_each_block(size, e.epilogue, output, [&](int64_t i, int64_t) HWY_ATTR {
        Block best = greater(load_block(input(0) + i), load_block(input(1) + i));
        for (size_t k = 2; k < operands.size(); ++k) best = greater(load_block(input(k) + i), best);
        return best;
      });
      break;
  }
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

}  // namespace revisit::engine::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace revisit::engine {

HWY_EXPORT(activation);
HWY_EXPORT(scale_shift);
HWY_EXPORT(eltwise);

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

}  // namespace revisit::engine
#endif  // HWY_ONCE
