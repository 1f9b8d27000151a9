// Traits are defined by properties instead of target names, so that new targets of Highway
// (AVX3_SPR, AVX10, NEON_BF16 ...) work. Included once per target.
#if defined(REVISIT_SIMD_TRAITS_INL_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef REVISIT_SIMD_TRAITS_INL_H_
#undef REVISIT_SIMD_TRAITS_INL_H_
#else
#define REVISIT_SIMD_TRAITS_INL_H_
#endif

#include <hwy/highway.h>

#include <cstdint>

#include "layout.h"

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

}  // namespace revisit::engine::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#endif
