#include <cblas.h>

#include "kernels/gemm.h"
#include "revisit/engine/machine.h"

namespace revisit::engine {
void gemm(const GemmProblem& p) {
  const OneBlasThread one_thread;  // callers split the work, independent of the number of threads
  const auto narrow = [](int64_t value) { return static_cast<blasint>(value); };
  cblas_sgemm(CblasRowMajor, p.transpose_a ? CblasTrans : CblasNoTrans,
              p.transpose_b ? CblasTrans : CblasNoTrans, narrow(p.m), narrow(p.n), narrow(p.k),
              1.0F, p.a, narrow(p.lda), p.b, narrow(p.ldb), 0.0F, p.c, narrow(p.ldc));
}

}  // namespace revisit::engine
