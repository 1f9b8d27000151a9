#pragma once

#include <cstdint>

namespace revisit::engine {

/// C[m][n] = A * B, row-major with leading dimensions, on the calling thread only, so that the
/// result does not depend on how many threads share the work around it. A is [m][k], or [k][m] when
/// `transpose_a`; B is [k][n], or [n][k] when `transpose_b`. A kernel that calls it says so by
/// Work::uses_blas: a run then makes room for OpenBLAS's buffers, as a pass cannot fail.
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
