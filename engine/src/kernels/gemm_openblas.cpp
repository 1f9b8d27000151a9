#include <cblas.h>

#include "kernels/gemm.h"

namespace revisit::engine {
namespace {

/// OpenBLAS's own threads stay off: the work is split outside, the same way for any thread count.
bool use_one_thread() {
  openblas_set_num_threads(1);
  return true;
}

}  // namespace

void gemm(const GemmProblem& p) {
  static const bool configured = use_one_thread();
  static_cast<void>(configured);
  const auto narrow = [](int64_t value) { return static_cast<blasint>(value); };
  cblas_sgemm(CblasRowMajor, p.transpose_a ? CblasTrans : CblasNoTrans,
              p.transpose_b ? CblasTrans : CblasNoTrans, narrow(p.m), narrow(p.n), narrow(p.k),
              1.0F, p.a, narrow(p.lda), p.b, narrow(p.ldb), 0.0F, p.c, narrow(p.ldc));
}

}  // namespace revisit::engine
