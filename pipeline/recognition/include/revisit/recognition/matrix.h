#pragma once

#include <complex>
#include <cstdint>
#include <functional>
#include <span>
#include <vector>

namespace revisit {

/// Accessor for rows of floats `[n][d]` in any storage.
struct Rows {
  int64_t n = 0, d = 0;                                ///< rows and columns
  std::function<std::span<const float>(int64_t)> row;  ///< [d] of a row
};

/// One descriptor per row; row i is scan i of the data set.
struct FloatMatrix {
  int64_t n = 0, d = 0;       ///< rows and columns
  std::vector<float> values;  ///< [n][d], C order

  FloatMatrix() = default;
  /// Zeros.
  FloatMatrix(int64_t rows, int64_t columns)
      : n(rows), d(columns), values(static_cast<size_t>(rows * columns)) {}
  /// Row i [d].
  std::span<const float> row(int64_t i) const {
    return {values.data() + i * d, static_cast<size_t>(d)};
  }
  /// Row i [d].
  std::span<float> row(int64_t i) { return {values.data() + i * d, static_cast<size_t>(d)}; }
  /// Refers to this matrix.
  Rows rows() const {
    return {n, d, [this](int64_t i) { return row(i); }};
  }
};

/// Euclidean norm, computed in double. Equal input gives equal bits.
double length_of(std::span<const float> x);

/// Computed in double; 0 for a zero row. Equal input gives equal bits.
double cosine(std::span<const float> a, double length_a, std::span<const float> b, double length_b);

/// Dense products and eigenvectors. Each runs on one thread, regardless of the library's global
/// setting; callers split the work in a way that does not depend on the number of threads. All
/// throw std::bad_alloc if the library's work buffer (128 MiB per thread) cannot be allocated.

/// C [m][n] = A [m][k] B^T, B [n][k]; row-major with row strides `lda`, `ldb`, `ldc`.
void multiply_transposed(int64_t m, int64_t n, int64_t k, const float* a, int64_t lda,
                         const float* b, int64_t ldb, float* c, int64_t ldc);
/// As above, in double.
void multiply_transposed(int64_t m, int64_t n, int64_t k, const double* a, int64_t lda,
                         const double* b, int64_t ldb, double* c, int64_t ldc);

/// Upper triangle of C [m][m] = A A^T, A [m][k]; the rest of C is not written.
void multiply_by_own_transpose(int64_t m, int64_t k, const float* a, int64_t lda, float* c,
                               int64_t ldc);

/// C [m][n] = A [m][k] B, B [k][n]; row-major.
void multiply(int64_t m, int64_t n, int64_t k, const float* a, int64_t lda, const float* b,
              int64_t ldb, float* c, int64_t ldc);

/// C [m][m] += factor A B^H, A and B [m][k]; complex and column-major.
void add_product_with_adjoint(int64_t m, int64_t k, double factor, const std::complex<double>* a,
                              const std::complex<double>* b, std::complex<double>* c);

/// The `k` largest eigenvalues of a symmetric matrix, in descending order, with orthonormal
/// eigenvectors. Each eigenvector's entry of largest magnitude is positive, so that equal input
/// gives equal files.
struct Eigenpairs {
  std::vector<double> values;   ///< [k]
  std::vector<double> vectors;  ///< [k][m], one eigenvector per row
};
/// `a` [m][m] is row-major, upper triangle, and is overwritten; k <= m. Throws Error if LAPACK does
/// not converge.
Eigenpairs largest_eigenpairs(std::vector<double>& a, int64_t m, int64_t k);

/// Solves A v = l B v. Returns all eigenvalues [m] in ascending order. A [m][m] is Hermitian, B
/// positive definite; both are column-major, lower triangles. `a` is overwritten by the
/// eigenvectors, one per column, with v_i^H B v_j = 1 for i = j, else 0; `b` is overwritten. Each
/// eigenvector has a positive inner product with a fixed real vector, so that its phase is
/// reproducible. Throws Error if LAPACK does not converge or B is not positive definite.
std::vector<double> hermitian_eigenpairs(std::complex<double>* a, std::complex<double>* b,
                                         int64_t m);

}  // namespace revisit
