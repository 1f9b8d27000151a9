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

}  // namespace revisit::engine
