#include "revisit/engine/simd.h"

#include <hwy/highway.h>

namespace revisit::engine {

std::string simd_target() {
  // Highway gives better targets lower bits and calls AVX-512 AVX3.
  const int64_t usable = hwy::SupportedTargets() & HWY_TARGETS;
  const std::string name = hwy::TargetName(usable & -usable);
  return name.starts_with("AVX3") ? "AVX-512" : name;
}

}  // namespace revisit::engine
