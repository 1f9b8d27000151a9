#include "revisit/recognition/matrix.h"
#include "testing.h"

namespace revisit {
namespace {

using Complex = std::complex<double>;
constexpr int64_t kM = 7;

/// X X^H, [kM][kM] column-major, of random X; real when `imaginary` is 0.
std::vector<Complex> positive_definite(unsigned seed, double imaginary) {
  std::mt19937 random(seed);
  std::normal_distribution<double> normal;
  std::vector<Complex> x(kM * 2 * kM), square(kM * kM);
  for (Complex& value : x) value = {normal(random), imaginary * normal(random)};
  for (int64_t j = 0; j < kM; ++j)
    for (int64_t i = 0; i < kM; ++i)
      for (int64_t k = 0; k < 2 * kM; ++k)
        square[i + j * kM] += x[i + k * kM] * std::conj(x[j + k * kM]);
  return square;
}

/// x^H A y of columns.
Complex form(const Complex* x, const std::vector<Complex>& a, const Complex* y) {
  Complex sum = 0;
  for (int64_t j = 0; j < kM; ++j)
    for (int64_t i = 0; i < kM; ++i) sum += std::conj(x[i]) * a[i + j * kM] * y[j];
  return sum;
}

TEST(LinearAlgebra, HermitianEigenpairsSolveTheirEquation) {
  for (const double imaginary : {0.0, 1.0}) {
    const std::vector<Complex> a = positive_definite(1, imaginary);
    const std::vector<Complex> b = positive_definite(2, imaginary);
    std::vector<Complex> v = a, destroyed = b;
    const std::vector<double> values = hermitian_eigenpairs(v.data(), destroyed.data(), kM);
    ASSERT_EQ(values.size(), static_cast<size_t>(kM));
    for (int64_t i = 0; i < kM; ++i) {
      for (int64_t j = 0; j < kM; ++j) {
        const double one = i == j ? 1 : 0;
        EXPECT_LT(std::abs(form(&v[i * kM], b, &v[j * kM]) - one), 1e-12);
        EXPECT_LT(std::abs(form(&v[i * kM], a, &v[j * kM]) - one * values[i]),
                  1e-12 * values[kM - 1]);
      }
      EXPECT_GE(values[i], i > 0 ? values[i - 1] : 0.0);
      Complex with_fixed = 0;
      for (int64_t k = 0; k < kM; ++k) with_fixed += std::cos(double(k * k)) * v[i * kM + k];
      EXPECT_GT(with_fixed.real(), 0);
      EXPECT_LT(std::abs(with_fixed.imag()), 1e-12);
      for (int64_t k = 0; k < kM; ++k) EXPECT_TRUE(imaginary != 0 || v[i * kM + k].imag() == 0);
    }
  }
  std::vector<Complex> a = positive_definite(1, 1), zero(kM * kM);
  EXPECT_THROW(hermitian_eigenpairs(a.data(), zero.data(), kM), Error);
}

TEST(LinearAlgebra, AProductWithAnAdjointIsAdded) {
  const std::vector<Complex> a{{1, 2}, {0, 1}}, b{{3, 0}, {1, -1}};  // [2][1]
  std::vector<Complex> c{10, 0, 0, 0};
  add_product_with_adjoint(2, 1, 0.5, a.data(), b.data(), c.data());
  EXPECT_EQ(c, (std::vector<Complex>{{11.5, 3}, {0, 1.5}, {-0.5, 1.5}, {-0.5, 0.5}}));
}

}  // namespace
}  // namespace revisit
