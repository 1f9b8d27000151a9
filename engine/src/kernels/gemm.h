#pragma once

#include <cstdint>

namespace revisit::engine {

/// C[m][n] = A * B, row-major with leading dimensions, on the calling thread only, so that results
/// do not depend on the number of threads around it. A is [m][k], or [k][m] with `transpose_a`; B
/// is [k][n], or [n][k] with `transpose_b`. A calling kernel must set Work::uses_blas: the run then
/// reserves OpenBLAS's buffers, because a pass must not fail.
struct GemmProblem {
  int64_t m, n, k;
  const float* a;
  int64_t lda;
  const float* b;
  int64_t ldb;
  bool transpose_b;
  float* c;
  int64_t ldc;
  bool transpose_a = false;
};
void gemm(const GemmProblem& problem);

/// Checks that address space is left for OpenBLAS's work buffers, 128 MiB per thread that
/// multiplies at the same time. The caller must hold it while multiplying.
class BlasWorkspace {
 public:
  /// Throws std::bad_alloc if `threads` buffers do not fit next to those of all other holders.
  explicit BlasWorkspace(int threads);
  ~BlasWorkspace();
  BlasWorkspace(const BlasWorkspace&) = delete;
  BlasWorkspace& operator=(const BlasWorkspace&) = delete;

 private:
  int threads_;
};

}  // namespace revisit::engine
