#include "kernels/blocked/dispatch.h"

#include <hwy/targets.h>

#include "revisit/engine/simd.h"

namespace revisit::engine {
namespace {

[[maybe_unused]] bool has(Instructions instructions) {
  switch (instructions) {
    case Instructions::kBf16:
      return has_bf16_instructions();
    case Instructions::kTiles:
      return has_bf16_tiles();
    case Instructions::kFloat32:
      break;
  }
  return true;
}

}  // namespace

bool has_blocked_kernels() {
  return (hwy::SupportedTargets() & HWY_TARGETS) != 0;
}

size_t target_index([[maybe_unused]] Instructions instructions) {
#if (HWY_TARGETS & (HWY_TARGETS - 1)) == 0
  return 0;  // the tables have one target
#else
  int64_t targets = hwy::SupportedTargets();
#if HWY_ARCH_X86
  if (!has(instructions)) targets &= ~(HWY_AVX3 | HWY_AVX3_DL);
#endif
  hwy::ChosenTarget chosen;
  chosen.Update(targets);
  return chosen.GetIndex();
#endif
}

}  // namespace revisit::engine
