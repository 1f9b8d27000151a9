#include <cblas.h>

#include <algorithm>
#include <cmath>

#include "revisit/base/error.h"
#include "revisit/engine/machine.h"
#include "revisit/recognition/matrix.h"

// LAPACK's symbols; OpenBLAS contains them, so that LAPACKE is not needed.
extern "C" void dsyevr_(const char* jobz, const char* range, const char* uplo, const int* n,
                        double* a, const int* lda, const double* vl, const double* vu,
                        const int* il, const int* iu, const double* abstol, int* m, double* w,
                        double* z, const int* ldz, int* isuppz, double* work, const int* lwork,
                        int* iwork, const int* liwork, int* info, size_t jobz_length,
                        size_t range_length, size_t uplo_length);
extern "C" void zhegvd_(const int* itype, const char* jobz, const char* uplo, const int* n,
                        std::complex<double>* a, const int* lda, std::complex<double>* b,
                        const int* ldb, double* w, std::complex<double>* work, const int* lwork,
                        double* rwork, const int* lrwork, int* iwork, const int* liwork, int* info,
                        size_t jobz_length, size_t uplo_length);

namespace revisit {
namespace {

int as_int(int64_t value) {
  return static_cast<int>(value);
}

}  // namespace

void multiply_transposed(int64_t m, int64_t n, int64_t k, const float* a, int64_t lda,
                         const float* b, int64_t ldb, float* c, int64_t ldc) {
  const engine::OneBlasThread one_thread;
  cblas_sgemm(CblasRowMajor, CblasNoTrans, CblasTrans, as_int(m), as_int(n), as_int(k), 1, a,
              as_int(lda), b, as_int(ldb), 0, c, as_int(ldc));
}

void multiply_by_own_transpose(int64_t m, int64_t k, const float* a, int64_t lda, float* c,
                               int64_t ldc) {
  const engine::OneBlasThread one_thread;
  cblas_ssyrk(CblasRowMajor, CblasUpper, CblasNoTrans, as_int(m), as_int(k), 1, a, as_int(lda), 0,
              c, as_int(ldc));
}

void multiply(int64_t m, int64_t n, int64_t k, const float* a, int64_t lda, const float* b,
              int64_t ldb, float* c, int64_t ldc) {
  const engine::OneBlasThread one_thread;
  cblas_sgemm(CblasRowMajor, CblasNoTrans, CblasNoTrans, as_int(m), as_int(n), as_int(k), 1, a,
              as_int(lda), b, as_int(ldb), 0, c, as_int(ldc));
}

void multiply_transposed(int64_t m, int64_t n, int64_t k, const double* a, int64_t lda,
                         const double* b, int64_t ldb, double* c, int64_t ldc) {
  const engine::OneBlasThread one_thread;
  cblas_dgemm(CblasRowMajor, CblasNoTrans, CblasTrans, as_int(m), as_int(n), as_int(k), 1, a,
              as_int(lda), b, as_int(ldb), 0, c, as_int(ldc));
}

void add_product_with_adjoint(int64_t m, int64_t k, double factor, const std::complex<double>* a,
                              const std::complex<double>* b, std::complex<double>* c) {
  const engine::OneBlasThread one_thread;
  const std::complex<double> alpha = factor, beta = 1;
  cblas_zgemm(CblasColMajor, CblasNoTrans, CblasConjTrans, as_int(m), as_int(m), as_int(k), &alpha,
              a, as_int(m), b, as_int(m), &beta, c, as_int(m));
}

Eigenpairs largest_eigenpairs(std::vector<double>& a, int64_t m, int64_t k) {
  const engine::OneBlasThread one_thread;
  const int n = as_int(m), first = as_int(m - k + 1), last = n;  // 1-based, ascending
  const double unused = 0, tolerance = 0;
  int found = 0, info = 0, work_size = -1, iwork_size = -1, best_iwork = 0;
  double best_work = 0;
  std::vector<double> values(m), vectors(k * m);
  std::vector<int> support(2 * std::max<int64_t>(1, k));
  const auto solve = [&](double* work, int* iwork) {
    // The upper triangle by rows is LAPACK's lower triangle by columns.
    dsyevr_("V", "I", "L", &n, a.data(), &n, &unused, &unused, &first, &last, &tolerance, &found,
            values.data(), vectors.data(), &n, support.data(), work, &work_size, iwork, &iwork_size,
            &info, 1, 1, 1);
  };
  solve(&best_work, &best_iwork);  // queries the work sizes
  work_size = static_cast<int>(best_work);
  iwork_size = best_iwork;
  std::vector<double> work(work_size);
  std::vector<int> iwork(iwork_size);
  solve(work.data(), iwork.data());
  if (info != 0 || found != k)
    throw Error("the eigenvalues of a ", m, " x ", m,
                " matrix did not converge (LAPACK dsyevr: ", info, ", ", found, " of ", k,
                " found)");

  Eigenpairs pairs{std::vector<double>(k), std::vector<double>(k * m)};
  for (int64_t i = 0; i < k; ++i) {
    pairs.values[i] = values[k - 1 - i];
    const auto vector = vectors.begin() + (k - 1 - i) * m;
    const double largest = *std::max_element(
        vector, vector + m, [](double x, double y) { return std::abs(x) < std::abs(y); });
    std::transform(vector, vector + m, pairs.vectors.begin() + i * m,
                   [sign = largest < 0 ? -1 : 1](double value) { return sign * value; });
  }
  return pairs;
}

std::vector<double> hermitian_eigenpairs(std::complex<double>* a, std::complex<double>* b,
                                         int64_t m) {
  const engine::OneBlasThread one_thread;
  const int n = as_int(m), kind = 1;  // A v = l B v
  int info = 0, size = -1, real_size = -1, int_size = -1;
  std::vector<double> values(m), real_work(1);
  std::vector<std::complex<double>> work(1);
  std::vector<int> int_work(1);
  const auto solve = [&] {
    zhegvd_(&kind, "V", "L", &n, a, &n, b, &n, values.data(), work.data(), &size, real_work.data(),
            &real_size, int_work.data(), &int_size, &info, 1, 1);
  };
  solve();
  size = static_cast<int>(work[0].real());
  real_size = static_cast<int>(real_work[0]);
  int_size = int_work[0];
  work.resize(size);
  real_work.resize(real_size);
  int_work.resize(int_size);
  solve();
  if (info != 0)
    throw Error("the eigenvalues of a Hermitian ", m, " x ", m,
                " matrix did not converge, or the right-hand matrix is not positive "
                "definite (LAPACK zhegvd: ",
                info, ")");
  std::vector<double> fixed(m);  // cos(k^2): no natural vector is orthogonal to it
  for (int64_t k = 0; k < m; ++k) fixed[k] = std::cos(static_cast<double>(k * k));
  for (int64_t i = 0; i < m; ++i) {
    std::complex<double>* const v = a + i * m;
    std::complex<double> product = 0;
    for (int64_t k = 0; k < m; ++k) product += fixed[k] * v[k];
    const double length = std::abs(product);
    if (length == 0) continue;
    for (int64_t k = 0; k < m; ++k) v[k] *= std::conj(product) / length;
  }
  return values;
}

}  // namespace revisit
