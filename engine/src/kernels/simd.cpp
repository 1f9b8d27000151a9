#include "revisit/engine/simd.h"

#include <hwy/highway.h>

namespace revisit::engine {

std::string simd_target() {
  // Highway gives better targets lower bits and calls AVX-512 AVX3.
  const int64_t usable = hwy::SupportedTargets() & HWY_TARGETS;
  const std::string name = hwy::TargetName(usable & -usable);
  return name.starts_with("AVX3") ? "AVX-512" : name;
}

bool has_bf16_instructions() {
#if HWY_ARCH_X86
  static const bool kHas = __builtin_cpu_supports("avx512bf16") != 0;
  return kHas;
#else
  return false;
#endif
}

}  // namespace revisit::engine
