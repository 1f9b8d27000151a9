#pragma once

#include <complex>
#include <cstdint>
#include <vector>

/// Dense products and eigenvectors, each on one thread, whatever other users of the library ask
/// for: the work is split outside, in the same way for any number of threads. All throw
/// std::bad_alloc when the library's work buffer (128 MiB a thread) has no room.
namespace revisit::pipeline {

/// C [m][n] = A [m][k] B^T, B [n][k]; row-major with row strides `lda`, `ldb`, `ldc`.
void multiply_transposed(int64_t m, int64_t n, int64_t k, const float* a, int64_t lda,
                         const float* b, int64_t ldb, float* c, int64_t ldc);
void multiply_transposed(int64_t m, int64_t n, int64_t k, const double* a, int64_t lda,
                         const double* b, int64_t ldb, double* c, int64_t ldc);

/// The upper triangle of C [m][m] = A A^T, A [m][k]; the rest of C is left as it is.
void multiply_by_own_transpose(int64_t m, int64_t k, const float* a, int64_t lda, float* c,
                               int64_t ldc);

/// C [m][n] = A [m][k] B, B [k][n]; row-major.
void multiply(int64_t m, int64_t n, int64_t k, const float* a, int64_t lda, const float* b,
              int64_t ldb, float* c, int64_t ldc);

/// C [m][m] += factor A B^H, A and B [m][k]; complex and column-major.
void add_product_with_adjoint(int64_t m, int64_t k, double factor, const std::complex<double>* a,
                              const std::complex<double>* b, std::complex<double>* c);

/// The `k` largest eigenvalues of a symmetric matrix, largest first, with orthonormal eigenvectors.
/// The entry of largest magnitude of each is positive, so that equal input gives equal files.
struct Eigenpairs {
  std::vector<double> values;   // [k]
  std::vector<double> vectors;  // [k][m], one eigenvector a row
};
/// `a` [m][m] row-major, upper triangle, destroyed; k <= m. Throws Error without convergence.
Eigenpairs largest_eigenpairs(std::vector<double>& a, int64_t m, int64_t k);

/// All eigenvalues l of A v = l B v, smallest first, [m]; A [m][m] Hermitian, B positive definite,
/// both column-major, lower triangles. `a` becomes the eigenvectors v, a column each, with
/// v_i^H B v_j = 1 for i = j, else 0; B is destroyed. An eigenvector has a positive inner product
/// with a fixed real vector, so that machines agree on its phase. Throws Error when LAPACK does not
/// converge or B is not positive definite.
std::vector<double> hermitian_eigenpairs(std::complex<double>* a, std::complex<double>* b,
                                         int64_t m);

}  // namespace revisit::pipeline
