#include "revisit/engine/blas.h"

#include <cblas.h>

#include <algorithm>
#include <array>

namespace revisit::engine {
#ifdef __x86_64__
namespace {

/// Widest vectors a kernel set uses.
enum class Vectors { kOlder, kAvx2, kAvx512 };

Vectors vectors_of(const std::string& core) {
  constexpr std::array kAvx512 = {"SkylakeX", "Cooperlake", "SapphireRapids"};
  constexpr std::array kAvx2 = {"Haswell", "Zen", "Excavator"};
  if (std::find(kAvx512.begin(), kAvx512.end(), core) != kAvx512.end()) return Vectors::kAvx512;
  if (std::find(kAvx2.begin(), kAvx2.end(), core) != kAvx2.end()) return Vectors::kAvx2;
  return Vectors::kOlder;
}

}  // namespace
#endif

std::string blas_core() {
  return openblas_get_corename();
}

std::string faster_blas_core() {
#ifdef __x86_64__
  const Vectors used = vectors_of(blas_core());
  const bool avx512 = __builtin_cpu_supports("avx512f") && __builtin_cpu_supports("avx512bw") &&
                      __builtin_cpu_supports("avx512dq") && __builtin_cpu_supports("avx512vl");
  if (avx512 && used < Vectors::kAvx512) return "SkylakeX";
  if (__builtin_cpu_supports("avx2") && __builtin_cpu_supports("fma") && used < Vectors::kAvx2)
    return "Haswell";
#endif
  return "";
}

}  // namespace revisit::engine
