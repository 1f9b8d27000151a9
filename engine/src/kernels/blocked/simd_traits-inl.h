// What kernels need to know of a SIMD target: all of it is here, said of properties and not of
// names, so that targets of a newer Highway (AVX3_SPR, AVX10, NEON_BF16 ...) are what they are.
// Highway includes this file once per target.
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
constexpr int kVectors = kLanes / kVectorLanes;  // registers of a block of kLanes channels

// Highway gives better targets of one architecture lower numbers, and x86 the lowest of all.
constexpr bool kIsAvx512 = HWY_ARCH_X86 && HWY_TARGET <= HWY_AVX3;

/// Vector registers.
constexpr int kRegisters = HWY_ARCH_X86_32 ? 8
                           : HWY_ARCH_X86  ? (kIsAvx512 ? 32 : 16)
                           : HWY_ARCH_ARM_A64 || HWY_ARCH_PPC || HWY_ARCH_RVV ? 32
                                                                              : 16;

/// Whether ApproximateReciprocalSqrt() is good to 14 bits, not 8 to 12.
constexpr bool kHasReciprocalRoot14 = kIsAvx512;

/// Whether Max(a, b) is `a > b ? a : b`: b where one is NaN or both are zeros; and Min(a, b)
/// likewise `a < b ? a : b`. It is one instruction of x86; elsewhere, and where vectors are only
/// emulated, it is something else.
constexpr bool kMaxIsFirstIfGreater =
    HWY_ARCH_X86 && HWY_TARGET != HWY_SCALAR && HWY_TARGET != HWY_EMU128;

}  // namespace revisit::engine::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#endif  // per-target include guard
