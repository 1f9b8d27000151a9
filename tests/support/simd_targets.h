#pragma once

#include <gtest/gtest.h>
#include <hwy/highway.h>

#include <algorithm>
#include <string>
#include <type_traits>
#include <utility>
#include <vector>

#include "kernels/blocked/kernels.h"
#include "revisit/engine/machine.h"

#define REVISIT_NEED_BLOCKED_KERNELS()           \
  if (!::revisit::engine::has_blocked_kernels()) \
  GTEST_SKIP() << "this CPU has no blocked kernels (of x86 it takes AVX2): all values are plain"

namespace revisit::test {

/// Forces one instruction set for its lifetime. Nests.
class ForceSimdTarget {
 public:
  explicit ForceSimdTarget(int64_t target) : outer_(std::exchange(forced_, target)) {
    hwy::SetSupportedTargetsForTest(target);
  }
  ~ForceSimdTarget() { hwy::SetSupportedTargetsForTest(forced_ = outer_); }
  ForceSimdTarget(const ForceSimdTarget&) = delete;
  ForceSimdTarget& operator=(const ForceSimdTarget&) = delete;

 private:
  static inline int64_t forced_ = 0;  // 0: none
  int64_t outer_;
};

/// A CPU for dispatch: float32 kernels use the target; so do bfloat16 kernels, unless it is AVX-512
/// without instructions for bfloat16.
struct SimdCase {
  int64_t target;
  engine::Instructions bf16;

  std::string name() const {
    static const char* const kBf16[] = {"", " with BF16", " with AMX"};
    return hwy::TargetName(target) + std::string(kBf16[static_cast<int>(bf16)]);
  }
};

/// Forces dispatch as on that CPU for its lifetime.
class ForceSimdCase {
 public:
  explicit ForceSimdCase(const SimdCase& c) : target_(c.target) {
    engine::limit_instructions(c.bf16);
  }
  ~ForceSimdCase() { engine::limit_instructions(engine::Instructions::kTiles); }
  ForceSimdCase(const ForceSimdCase&) = delete;
  ForceSimdCase& operator=(const ForceSimdCase&) = delete;

 private:
  ForceSimdTarget target_;
};

inline std::vector<SimdCase> simd_cases() {
  using engine::Instructions;
  std::vector<SimdCase> cases;
  for (const int64_t target : hwy::SupportedAndGeneratedTargets()) {
    cases.push_back({target, Instructions::kFloat32});
#if HWY_ARCH_X86
    if (target > HWY_AVX3) continue;  // Highway numbers better targets lower
    if (engine::has_bf16_instructions()) cases.push_back({target, Instructions::kBf16});
    if (engine::has_bf16_tiles()) cases.push_back({target, Instructions::kTiles});
#endif
  }
  return cases;
}

inline int64_t bf16_target(const SimdCase& c) {
#if HWY_ARCH_X86
  if (c.bf16 == engine::Instructions::kFloat32) return std::max<int64_t>(c.target, HWY_AVX2);
#endif
  return c.target;
}

/// Calls `check()` with each compiled instruction set of this CPU forced.
template <class Check>
void for_each_simd_target(const Check& check) {
  for (const int64_t target : hwy::SupportedAndGeneratedTargets()) {
    SCOPED_TRACE(hwy::TargetName(target));
    const ForceSimdTarget forced(target);
    check();
  }
}

/// Calls `check(case)` or `check()` for each SimdCase with NCHWc kernels.
template <class Check>
void for_each_blocked_case(const Check& check) {
  for (const SimdCase& c : simd_cases()) {
    SCOPED_TRACE(c.name());
    const ForceSimdCase forced(c);
    if (!engine::has_blocked_kernels()) continue;
    if constexpr (std::is_invocable_v<Check, const SimdCase&>)
      check(c);
    else
      check();
  }
}

}  // namespace revisit::test
