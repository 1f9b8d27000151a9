#include <hwy/targets.h>

#include <algorithm>

#include "kernels/blocked/kernels.h"
#include "revisit/engine/machine.h"

namespace revisit::engine {
namespace {

/// Caches the query, because it takes as long as a small layer.
[[maybe_unused]] size_t best_index() {
  hwy::ChosenTarget& chosen = hwy::GetChosenTarget();
  if (!chosen.IsInitialized()) chosen.Update(hwy::SupportedTargets());
  return chosen.GetIndex();
}

[[maybe_unused]] size_t index_of(int64_t target) {
  hwy::ChosenTarget chosen;
  chosen.Update(target);
  return chosen.GetIndex();
}

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

#if (HWY_TARGETS & (HWY_TARGETS - 1)) == 0

bool has_blocked_kernels() {
  return (hwy::SupportedTargets() & HWY_TARGETS) != 0;
}

size_t target_index(Instructions) {
  return 0;  // the tables have one target
}

#else

bool has_blocked_kernels() {
  return best_index() <= HWY_MAX_DYNAMIC_TARGETS;  // later targets need no SIMD instructions
}

size_t target_index(Instructions instructions) {
#if HWY_ARCH_X86
  static const size_t kAvx2 = index_of(HWY_AVX2);  // better targets have lower indices
  if (!has(instructions)) return std::max(best_index(), kAvx2);
#endif
  return best_index();
}

#endif

}  // namespace revisit::engine
