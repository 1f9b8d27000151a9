// Holds kLanes floats in as many registers as the target needs. Traits are defined by properties
// instead of target names, so that new targets of Highway (AVX3_SPR, AVX10, NEON_BF16 ...) work.
// Included once per target.
#if defined(REVISIT_BLOCK_INL_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef REVISIT_BLOCK_INL_H_
#undef REVISIT_BLOCK_INL_H_
#else
#define REVISIT_BLOCK_INL_H_
#endif

#include <hwy/highway.h>

#include <cstdint>

#include "layout.h"
#include "revisit/engine/tensor.h"

// Loops over registers must be fully unrolled, because registers cannot be indexed.
#undef REVISIT_UNROLL
#define REVISIT_UNROLL _Pragma("GCC unroll 32")

HWY_BEFORE_NAMESPACE();
namespace revisit::engine::HWY_NAMESPACE {
namespace hn = hwy::HWY_NAMESPACE;

using Tag = hn::CappedTag<float, kLanes>;
using Vector = hn::Vec<Tag>;
constexpr int64_t kVectorLanes = hn::MaxLanes(Tag());
constexpr int kVectors = kLanes / kVectorLanes;

// Better targets of an architecture have lower numbers in Highway, and x86 has the lowest.
constexpr bool kIsAvx512 = HWY_ARCH_X86 && HWY_TARGET <= HWY_AVX3;

constexpr int kRegisters = HWY_ARCH_X86_32 ? 8
                           : HWY_ARCH_X86  ? (kIsAvx512 ? 32 : 16)
                           : HWY_ARCH_ARM_A64 || HWY_ARCH_PPC || HWY_ARCH_RVV ? 32
                                                                              : 16;

/// ApproximateReciprocalSqrt() is accurate to 14 bits instead of 8 to 12.
constexpr bool kHasReciprocalRoot14 = kIsAvx512;

/// Max(a, b) is `a > b ? a : b`, so b if one is NaN or both are zeros, and Min(a, b) is `a < b ? a
/// : b`. True for the x86 instructions; other and emulated targets differ.
constexpr bool kMaxIsFirstIfGreater =
    HWY_ARCH_X86 && HWY_TARGET != HWY_SCALAR && HWY_TARGET != HWY_EMU128;

using Bits = hn::Rebind<uint32_t, Tag>;
using HalfBits = hn::Rebind<uint16_t, Tag>;

HWY_INLINE Vector load_vector(const float* from) {
  return hn::Load(Tag(), from);
}

HWY_INLINE Vector load_vector(const BFloat16* from) {
  const auto half = hn::Load(HalfBits(), &from->bits);
  return hn::BitCast(Tag(), hn::ShiftLeft<16>(hn::PromoteTo(Bits(), half)));
}

HWY_INLINE void store_vector(Vector v, float* to) {
  hn::Store(v, Tag(), to);
}

/// Like to_bfloat16(), but the instruction treats denormals as zero.
HWY_INLINE void store_vector(Vector v, BFloat16* to) {
#if HWY_ARCH_X86 && HWY_TARGET <= HWY_AVX3
  // Assembly, because the instruction is newer than Highway's targets and some compilers.
  __m256i half;
  asm("vcvtneps2bf16 %1, %0" : "=v"(half) : "v"(v.raw));
  _mm256_storeu_si256(reinterpret_cast<__m256i*>(to), half);
#else
  const Bits d;
  const auto bits = hn::BitCast(d, v);
  const auto odd = hn::And(hn::ShiftRight<16>(bits), hn::Set(d, 1));
  const auto rounded = hn::Add(bits, hn::Add(odd, hn::Set(d, 0x7FFF)));
  const auto is_number = hn::RebindMask(d, hn::Eq(v, v));
  const auto whole = hn::IfThenElse(is_number, rounded, hn::Or(bits, hn::Set(d, 1 << 22)));
  hn::StoreU(hn::TruncateTo(HalfBits(), hn::ShiftRight<16>(whole)), HalfBits(), &to->bits);
#endif
}

template <class Work>
HWY_INLINE void with_type(Precision values, const Work& work) {
  values == Precision::kFloat32 ? work(float()) : work(BFloat16());
}

struct Block {
  HWY_INLINE Block() {}  // g++ would generate it without the target attribute that NEON needs
  Vector v[kVectors];
};

HWY_INLINE Block zero_block() {
  Block r;
  REVISIT_UNROLL
  for (int i = 0; i < kVectors; ++i) r.v[i] = hn::Zero(Tag());
  return r;
}

template <class T>
HWY_INLINE Block load_block(const T* from) {
  Block r;
  REVISIT_UNROLL
  for (int i = 0; i < kVectors; ++i) r.v[i] = load_vector(from + i * kVectorLanes);
  return r;
}

template <class T>
HWY_INLINE void store_block(const Block& b, T* to) {
  REVISIT_UNROLL
  for (int i = 0; i < kVectors; ++i) store_vector(b.v[i], to + i * kVectorLanes);
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

HWY_INLINE Block mul_add(Vector factor, const Block& a, Block sum) {
  REVISIT_UNROLL
  for (int i = 0; i < kVectors; ++i) sum.v[i] = hn::MulAdd(factor, a.v[i], sum.v[i]);
  return sum;
}

HWY_INLINE Block mul_add(const Block& a, const Block& b, Block sum) {
  REVISIT_UNROLL
  for (int i = 0; i < kVectors; ++i) sum.v[i] = hn::MulAdd(a.v[i], b.v[i], sum.v[i]);
  return sum;
}

HWY_INLINE Block operator*(Block a, const Block& b) {
  REVISIT_UNROLL
  for (int i = 0; i < kVectors; ++i) a.v[i] = hn::Mul(a.v[i], b.v[i]);
  return a;
}

HWY_INLINE Block operator*(Vector factor, Block a) {
  REVISIT_UNROLL
  for (int i = 0; i < kVectors; ++i) a.v[i] = hn::Mul(factor, a.v[i]);
  return a;
}

}  // namespace revisit::engine::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#endif
