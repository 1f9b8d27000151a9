// Applies bias, addend and activation in registers. Included once per target.
#if defined(REVISIT_EPILOGUE_INL_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef REVISIT_EPILOGUE_INL_H_
#undef REVISIT_EPILOGUE_INL_H_
#else
#define REVISIT_EPILOGUE_INL_H_
#endif

#include <hwy/contrib/math/math-inl.h>

#include <algorithm>

#include "kernels/blocked/block-inl.h"
#include "kernels/epilogue.h"

HWY_BEFORE_NAMESPACE();
namespace revisit::engine::HWY_NAMESPACE {

/// Propagates NaN, because Highway's functions do not.
template <class V>
HWY_INLINE V keep_nan(V x, V result) {
  return hn::IfThenElse(hn::Eq(x, x), result, x);
}

/// e^-|x|, which cannot overflow.
template <class D, class V>
HWY_INLINE V exp_down(D d, V x) {
  return hn::Exp(d, hn::Or(x, hn::SignBit(d)));
}

template <class D, class V>
HWY_INLINE V sigmoid(D d, V x) {
  const V one = hn::Set(d, 1.0F), e = exp_down(d, x);
  const V upper = hn::IfThenElse(hn::Lt(x, hn::Zero(d)), e, one);
  return keep_nan(x, hn::Div(upper, hn::Add(one, e)));
}

template <class D, class V>
HWY_INLINE V tanh(D d, V x) {
  return keep_nan(x, hn::Tanh(d, x));
}

template <class D, class V>
HWY_INLINE V softplus(D d, V x) {
  return keep_nan(x, hn::Add(hn::Max(x, hn::Zero(d)), hn::Log1p(d, exp_down(d, x))));
}

/// `x` where x >= 0 or NaN, else `negative`.
HWY_INLINE Vector where_negative(Vector x, Vector negative) {
  return hn::IfThenElse(hn::Lt(x, hn::Zero(Tag())), negative, x);
}

/// slope * x + 0 for negative x, because Caffe's max(x, 0) + slope * min(x, 0) is never -0 there.
HWY_INLINE Vector leak(Vector slope, Vector x) {
  return hn::MulAdd(slope, x, hn::Zero(Tag()));
}

template <int kCount, class Function>
HWY_INLINE void change_each(Block (&blocks)[kCount], const Function& function) {
  REVISIT_UNROLL
  for (Block& block : blocks) {
    REVISIT_UNROLL
    for (int i = 0; i < kVectors; ++i) block.v[i] = function(block.v[i], i);
  }
}

/// x tanh(ln(1 + exp(x))) = x n / d with polynomials n, d of exp(-|x|), so it cannot overflow.
HWY_INLINE Vector mish(Vector x) {
  const Tag d;
  const Vector one = hn::Set(d, 1.0F), two = hn::Set(d, 2.0F);
  const Vector e = hn::CallExp(d, hn::Neg(hn::Abs(x)));
  const auto negative = hn::Lt(x, hn::Zero(d));
  const Vector n = hn::IfThenElse(negative, hn::Mul(e, hn::Add(e, two)), hn::MulAdd(two, e, one));
  const Vector rest = hn::IfThenElse(negative, two, hn::Mul(two, hn::Mul(e, e)));
  return hn::Mul(x, hn::Div(n, hn::Add(n, rest)));
}

/// Activations with many instructions, which unrolled kernels call.
inline HWY_NOINLINE void smooth(const Epilogue& e, Block* blocks, int count) {
  using Activation = Epilogue::Activation;
  const Tag d;
  const Vector slope = hn::Set(d, e.slope), one = hn::Set(d, 1.0F);
  for (int i = 0; i < count; ++i)
    for (Vector& x : blocks[i].v) {
      if (e.activation == Activation::kElu)
        x = where_negative(x, leak(slope, hn::Sub(hn::CallExp(d, x), one)));
      else if (e.activation == Activation::kSigmoid)
        x = sigmoid(d, x);
      else if (e.activation == Activation::kSwish)
        x = hn::Mul(x, sigmoid(d, hn::Mul(slope, x)));
      else if (e.activation == Activation::kTanh)
        x = tanh(d, x);
      else if (e.activation == Activation::kBnll)
        x = softplus(d, x);
      else
        x = mish(x);
    }
}

struct Relu {
  Vector slope;
  HWY_INLINE Vector operator()(Vector x, int) const { return where_negative(x, leak(slope, x)); }
};

struct Clip {
  Vector low, high;
  HWY_INLINE Vector operator()(Vector x, int) const {
    // Preserves NaN: comparisons with NaN are false, so x remains.
    if constexpr (kMaxIsFirstIfGreater) return hn::Min(high, hn::Max(low, x));
    return hn::IfThenElse(hn::Lt(x, low), low, hn::IfThenElse(hn::Gt(x, high), high, x));
  }
};

template <int kCount>
HWY_INLINE void activate(const Epilogue& e, const float* slopes, Block (&blocks)[kCount]) {
  using Activation = Epilogue::Activation;
  const Tag d;
  switch (e.activation) {
    case Activation::kNone:
      break;
    case Activation::kRelu:
      change_each(blocks, Relu{hn::Set(d, e.slope)});
      break;
    case Activation::kPrelu:
      change_each(blocks, [=](Vector x, int i) HWY_ATTR {
        return where_negative(x, leak(hn::Load(d, slopes + i * kVectorLanes), x));
      });
      break;
    case Activation::kClip:
      change_each(blocks, Clip{hn::Set(d, e.low), hn::Set(d, e.high)});
      break;
    default: {
      Block copy[kCount];  // registers have no address
      REVISIT_UNROLL
      for (int i = 0; i < kCount; ++i) copy[i] = blocks[i];
      smooth(e, copy, kCount);
      REVISIT_UNROLL
      for (int i = 0; i < kCount; ++i) blocks[i] = copy[i];
    }
  }
}

HWY_INLINE Block first_lanes(int64_t lanes, Block x) {
  REVISIT_UNROLL
  for (int i = 0; i < kVectors; ++i) {
    const int64_t here = std::clamp<int64_t>(lanes - i * kVectorLanes, 0, kVectorLanes);
    x.v[i] = hn::IfThenElseZero(hn::FirstN(Tag(), static_cast<size_t>(here)), x.v[i]);
  }
  return x;
}

class BlockEpilogue {
 public:
  /// For the channels from `block * kLanes`, out of `channels`.
  BlockEpilogue(const Epilogue& epilogue, const float* bias, int64_t block, int64_t channels)
      : epilogue_(epilogue),
        bias_(load_block(bias + block * kLanes)),
        slopes_(epilogue.slopes ? epilogue.slopes + block * kLanes : nullptr),
        lanes_(std::min(channels - block * kLanes, kLanes)) {}

  /// Finishes pixels `step` values apart; `addend` is null or that of the first pixel. Each
  /// frequent activation has a path of its own: where paths meet, sums would be stored and loaded
  /// again.
  template <class T, int kCount>
  HWY_INLINE void finish(const Block (&sums)[kCount], const T* addend, T* output,
                         int64_t step = kLanes) const {
    using Activation = Epilogue::Activation;
    const Activation activation = epilogue_.activation;
    const bool whole = lanes_ >= kLanes;
    const Tag d;
    if (whole && activation == Activation::kNone) {
      write(sums, addend, output, step, [](Vector x, int) HWY_ATTR { return x; });
    } else if (whole && activation == Activation::kRelu) {
      write(sums, addend, output, step, Relu{hn::Set(d, epilogue_.slope)});
    } else if (whole && activation == Activation::kClip) {
      write(sums, addend, output, step,
            Clip{hn::Set(d, epilogue_.low), hn::Set(d, epilogue_.high)});
    } else {
      Block copy[kCount];  // registers have no address
      REVISIT_UNROLL
      for (int i = 0; i < kCount * kVectors; ++i)
        copy[i / kVectors].v[i % kVectors] = sums[i / kVectors].v[i % kVectors];
      finish_any(copy, kCount, addend, output, step);
    }
  }

 private:
  template <class T, int kCount, class Function>
  HWY_INLINE void write(const Block (&sums)[kCount], const T* addend, T* output, int64_t step,
                        const Function& function) const {
    const Block bias = bias_;
    const auto write_pixel = [&](int i, Block x) HWY_ATTR {
      REVISIT_UNROLL
      for (int v = 0; v < kVectors; ++v) x.v[v] = function(x.v[v], v);
      store_block(x, output + i * step);
    };
    if (addend) {
      REVISIT_UNROLL
      for (int i = 0; i < kCount; ++i)
        write_pixel(i, sums[i] + bias + load_block(addend + i * step));
    } else {
      REVISIT_UNROLL
      for (int i = 0; i < kCount; ++i) write_pixel(i, sums[i] + bias);
    }
  }

  template <class T>
  HWY_NOINLINE void finish_any(const Block* sums, int count, const T* addend, T* output,
                               int64_t step) const {
    for (int i = 0; i < count; ++i, output += step) {
      Block x[1] = {sums[i] + bias_};
      if (addend) x[0] = x[0] + load_block(addend + i * step);
      activate(epilogue_, slopes_, x);
      // Padding lanes may be nonzero, e.g. for 0 * infinity or activations that map 0 to nonzero.
      store_block(lanes_ < kLanes ? first_lanes(lanes_, x[0]) : x[0], output);
    }
  }

  Epilogue epilogue_;
  Block bias_;
  const float* slopes_;
  int64_t lanes_;
};

}  // namespace revisit::engine::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#endif
