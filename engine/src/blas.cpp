#include "revisit/engine/blas.h"

#include <cblas.h>
#include <omp.h>

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

namespace {

bool blas_is_on_openmp() {
  static const bool kIs = openblas_get_parallel() == OPENBLAS_OPENMP;
  return kIs;
}

}  // namespace

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

OneBlasThread::OneBlasThread() {
  if (blas_is_on_openmp()) {
    openmp_threads_ = omp_get_max_threads();
    omp_set_num_threads(1);
    return;
  }
  static const bool kSet = [] {
    openblas_set_num_threads(1);
    return true;
  }();
  static_cast<void>(kSet);
}

OneBlasThread::~OneBlasThread() {
  if (blas_is_on_openmp()) omp_set_num_threads(openmp_threads_);
}

}  // namespace revisit::engine
