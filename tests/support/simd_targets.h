#pragma once

#include <gtest/gtest.h>
#include <hwy/highway.h>

namespace revisit::test {

/// Calls `check()` once for each set of instructions that the kernels are compiled for and this CPU
/// has, made to use it.
template <class Check>
void for_each_simd_target(const Check& check) {
  for (const int64_t target : hwy::SupportedAndGeneratedTargets()) {
    SCOPED_TRACE(hwy::TargetName(target));
    hwy::SetSupportedTargetsForTest(target);
    check();
    hwy::SetSupportedTargetsForTest(0);
  }
}

}  // namespace revisit::test
