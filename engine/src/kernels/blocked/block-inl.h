// A block of channels of one pixel, kLanes floats, in as many vector registers as the target needs.
// Highway includes this file once per target.
#if defined(REVISIT_BLOCK_INL_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef REVISIT_BLOCK_INL_H_
#undef REVISIT_BLOCK_INL_H_
#else
#define REVISIT_BLOCK_INL_H_
#endif

#include "kernels/blocked/simd_traits-inl.h"

// Loops over registers must be unrolled completely: a register has no index.
#ifndef REVISIT_UNROLL
#define REVISIT_UNROLL _Pragma("GCC unroll 32")
#endif

HWY_BEFORE_NAMESPACE();
namespace revisit::engine::HWY_NAMESPACE {

struct Block {
  HWY_INLINE Block() {}  // g++ would make its own outside of the target that NEON registers need
  Vector v[kVectors];
};

HWY_INLINE Block zero_block() {
  Block r;
  REVISIT_UNROLL
  for (int i = 0; i < kVectors; ++i) r.v[i] = hn::Zero(Tag());
  return r;
}

HWY_INLINE Block load_block(const float* from) {
  Block r;
  REVISIT_UNROLL
  for (int i = 0; i < kVectors; ++i) r.v[i] = hn::Load(Tag(), from + i * kVectorLanes);
  return r;
}

HWY_INLINE void store_block(const Block& b, float* to) {
  REVISIT_UNROLL
  for (int i = 0; i < kVectors; ++i) hn::Store(b.v[i], Tag(), to + i * kVectorLanes);
}

HWY_INLINE Block operator+(Block a, const Block& b) {
  REVISIT_UNROLL
  for (int i = 0; i < kVectors; ++i) a.v[i] = hn::Add(a.v[i], b.v[i]);
  return a;
}

HWY_INLINE Block operator-(Block a, const Block& b) {
  REVISIT_UNROLL
  for (int i = 0; i < kVectors; ++i) a.v[i] = hn::Sub(a.v[i], b.v[i]);
  return a;
}

/// factor * a + sum
HWY_INLINE Block mul_add(Vector factor, const Block& a, Block sum) {
  REVISIT_UNROLL
  for (int i = 0; i < kVectors; ++i) sum.v[i] = hn::MulAdd(factor, a.v[i], sum.v[i]);
  return sum;
}

/// a * b + sum
HWY_INLINE Block mul_add(const Block& a, const Block& b, Block sum) {
  REVISIT_UNROLL
  for (int i = 0; i < kVectors; ++i) sum.v[i] = hn::MulAdd(a.v[i], b.v[i], sum.v[i]);
  return sum;
}

HWY_INLINE Block operator*(Vector factor, Block a) {
  REVISIT_UNROLL
  for (int i = 0; i < kVectors; ++i) a.v[i] = hn::Mul(factor, a.v[i]);
  return a;
}

}  // namespace revisit::engine::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#endif  // per-target include guard
