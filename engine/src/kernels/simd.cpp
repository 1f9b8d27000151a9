#include <hwy/highway.h>

#include <atomic>

#include "kernels/blocked/kernels.h"
#include "revisit/engine/machine.h"

#if HWY_ARCH_X86_64 && defined(__linux__)
#include <cpuid.h>
#include <sys/syscall.h>
#include <unistd.h>
#endif

namespace revisit::engine {
namespace {

std::atomic<Instructions> bf16_limit = Instructions::kTiles;

bool has_amx() {
#if HWY_ARCH_X86_64 && defined(__linux__)
  // Not all compilers that support the instructions have them in __builtin_cpu_supports().
  constexpr unsigned kAmxBf16 = 1U << 22, kAmxTile = 1U << 24;
  unsigned eax = 0, ebx = 0, ecx = 0, edx = 0;
  return __get_cpuid_count(7, 0, &eax, &ebx, &ecx, &edx) != 0 && (edx & kAmxBf16) != 0 &&
         (edx & kAmxTile) != 0;
#else
  return false;
#endif
}

/// Requests AMX tiles: 8 KB of state per thread, which Linux saves only for processes with
/// permission (Documentation/arch/x86/xstate.rst).
bool tiles_are_permitted() {
#if HWY_ARCH_X86_64 && defined(__linux__)
  constexpr long kRequestPermission = 0x1023, kTileData = 18;
  return syscall(SYS_arch_prctl, kRequestPermission, kTileData) == 0;
#else
  return false;
#endif
}

}  // namespace

std::string simd_target() {
  // Better targets have lower bits in Highway, which calls AVX-512 AVX3.
  const int64_t usable = hwy::SupportedTargets() & HWY_TARGETS;
  const std::string name = hwy::TargetName(usable & -usable);
  return name.starts_with("AVX3") ? "AVX-512" : name;
}

bool has_bf16_instructions() {
#if HWY_ARCH_X86
  static const bool kHas = __builtin_cpu_supports("avx512bf16") != 0;
  return kHas && bf16_limit >= Instructions::kBf16;
#else
  return false;
#endif
}

bool has_bf16_tiles() {
  if (bf16_limit < Instructions::kTiles || !has_bf16_instructions()) return false;
  static const bool kHas = has_amx() && tiles_are_permitted();
  return kHas;
}

void limit_instructions(Instructions most) {
  bf16_limit = most;
}

std::string bf16_instructions() {
  if (has_bf16_tiles()) return "AMX tiles";
  if (has_bf16_instructions())
    return has_amx() ? "AVX512-BF16 (the operating system refuses AMX tiles)" : "AVX512-BF16";
  return "";
}

}  // namespace revisit::engine
