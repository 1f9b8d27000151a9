#pragma once

#include <gtest/gtest.h>
#include <hwy/highway.h>

#include "kernels/blocked/dispatch.h"

namespace revisit::test {

/// Makes the kernels use one set of instructions while it lives.
class ForceSimdTarget {
 public:
  explicit ForceSimdTarget(int64_t target) { hwy::SetSupportedTargetsForTest(target); }
  ~ForceSimdTarget() { hwy::SetSupportedTargetsForTest(0); }
  ForceSimdTarget(const ForceSimdTarget&) = delete;
  ForceSimdTarget& operator=(const ForceSimdTarget&) = delete;
};

/// Calls `check()` once for each set of instructions that the kernels are compiled for and this CPU
/// has, made to use it.
template <class Check>
void for_each_simd_target(const Check& check) {
  for (const int64_t target : hwy::SupportedAndGeneratedTargets()) {
    SCOPED_TRACE(hwy::TargetName(target));
    const ForceSimdTarget forced(target);
    check();
  }
}

/// The same for the sets that kernels on blocked values are compiled for.
template <class Check>
void for_each_blocked_target(const Check& check) {
  for_each_simd_target([&] {
    if (engine::has_blocked_kernels()) check();
  });
}

}  // namespace revisit::test
