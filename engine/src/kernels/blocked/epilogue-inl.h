// What happens to a block of output channels before it leaves the registers: bias, addend,
// activation. Highway includes this file once per target.
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

/// `x` where x >= 0 or NaN, else `negative`.
HWY_INLINE Vector where_negative(Vector x, Vector negative) {
  return hn::IfThenElse(hn::Lt(x, hn::Zero(Tag())), negative, x);
}

/// slope * x for negative x, added to the 0 that Caffe's expression adds it to: max(x, 0) + slope *
/// min(x, 0) is never -0 there.
HWY_INLINE Vector leak(Vector slope, Vector x) {
  return hn::MulAdd(slope, x, hn::Zero(Tag()));
}

/// `slopes` are those of the channels of `x`.
HWY_INLINE Block activate(const Epilogue& e, const float* slopes, Block x) {
  using Activation = Epilogue::Activation;
  const Tag d;
  switch (e.activation) {
    case Activation::kNone:
      break;
    case Activation::kRelu:
      REVISIT_UNROLL
      for (Vector& v : x.v) v = where_negative(v, leak(hn::Set(d, e.slope), v));
      break;
    case Activation::kPrelu: {
      REVISIT_UNROLL
      for (int i = 0; i < kVectors; ++i)
        x.v[i] = where_negative(x.v[i], leak(hn::Load(d, slopes + i * kVectorLanes), x.v[i]));
      break;
    }
    case Activation::kElu:
      for (Vector& v : x.v)
        v = where_negative(v,
                           leak(hn::Set(d, e.slope), hn::Sub(hn::CallExp(d, v), hn::Set(d, 1.0F))));
      break;
    case Activation::kClip:
      REVISIT_UNROLL
      for (Vector& v : x.v) {
        const Vector low = hn::Set(d, e.low), high = hn::Set(d, e.high);
        v = hn::IfThenElse(hn::Lt(v, low), low, hn::IfThenElse(hn::Gt(v, high), high, v));
      }
      break;
  }
  return x;
}

/// The first `lanes` lanes, zeros after them.
HWY_INLINE Block first_lanes(int64_t lanes, Block x) {
  REVISIT_UNROLL
  for (int i = 0; i < kVectors; ++i) {
    const int64_t here = std::clamp<int64_t>(lanes - i * kVectorLanes, 0, kVectorLanes);
    x.v[i] = hn::IfThenElseZero(hn::FirstN(Tag(), static_cast<size_t>(here)), x.v[i]);
  }
  return x;
}

/// The epilogue of one block of output channels.
class BlockEpilogue {
 public:
  /// Of the channels from `block * kLanes` on, of `channels` in all.
  BlockEpilogue(const Epilogue& epilogue, const float* bias, int64_t block, int64_t channels)
      : epilogue_(epilogue),
        bias_(load_block(bias + block * kLanes)),
        slopes_(epilogue.slopes ? epilogue.slopes + block * kLanes : nullptr),
        lanes_(std::min(channels - block * kLanes, kLanes)) {}

  /// `addend` is null or that of this pixel.
  template <class T>
  HWY_INLINE void finish(Block sum, const T* addend, T* output) const {
    sum = sum + bias_;
    if (addend) sum = sum + load_block(addend);
    sum = activate(epilogue_, slopes_, sum);
    // 0 * infinity and an activation of 0 need not be 0.
    if (lanes_ < kLanes) sum = first_lanes(lanes_, sum);
    store_block(sum, output);
  }

 private:
  Epilogue epilogue_;
  Block bias_;
  const float* slopes_;
  int64_t lanes_;
};

}  // namespace revisit::engine::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#endif  // per-target include guard
