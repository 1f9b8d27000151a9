// Winograd's matrices against the correlation in double precision. Both are bilinear, so exactness
// for unit vectors implies exactness for all inputs.
#include "kernels/blocked/winograd_transform.h"

#include "testing.h"

namespace revisit::engine {
namespace {

template <class Transform>
void expect_correlation() {
  for (int d = 0; d < Transform::kPoints; ++d)
    for (int g = 0; g < Transform::kTaps; ++g)
      for (int j = 0; j < Transform::kOutputs; ++j) {
        double sum = 0;
        for (int i = 0; i < Transform::kPoints; ++i)
          sum += Transform::kOutput[j][i] * Transform::kWeights[i][g] * Transform::kInput[i][d];
        EXPECT_NEAR(sum, j + g == d ? 1 : 0, 1e-10)
            << "F(" << Transform::kOutputs << ", " << Transform::kTaps << "): output " << j
            << ", input " << d << ", tap " << g;
      }
}

TEST(WinogradTransform, IsACorrelation) {
  expect_correlation<WinogradTransform<2, 3>>();
  expect_correlation<WinogradTransform<3, 3>>();
  expect_correlation<WinogradTransform<4, 3>>();
  expect_correlation<WinogradTransform<5, 3>>();
  expect_correlation<WinogradTransform<6, 3>>();
  expect_correlation<WinogradTransform<7, 3>>();
  expect_correlation<WinogradTransform<2, 5>>();
  expect_correlation<WinogradTransform<4, 5>>();
  expect_correlation<WinogradTransform<5, 5>>();
  expect_correlation<WinogradTransform<6, 5>>();
}

/// Symmetries that kernels use to share work between points +p and -p.
template <class Transform>
void expect_pairs() {
  for (int i = 1; i + 1 < Transform::kFinite; i += 2) {
    EXPECT_EQ(Transform::kAt[i], -Transform::kAt[i + 1]);
    for (int k = 0; k < Transform::kPoints; ++k)
      EXPECT_EQ(Transform::kInput[i + 1][k],
                k % 2 == 0 ? Transform::kInput[i][k] : -Transform::kInput[i][k]);
  }
  for (int k = 1; k < Transform::kPoints; k += 2) EXPECT_EQ(Transform::kInput[0][k], 0);
  if (Transform::kHasInfinity) {
    for (int k = 0; k < Transform::kPoints; k += 2)
      EXPECT_EQ(Transform::kInput[Transform::kPoints - 1][k], 0);
  }
}

TEST(WinogradTransform, PointsComeInPairs) {
  expect_pairs<WinogradTransform<4, 3>>();
  expect_pairs<WinogradTransform<5, 3>>();
  expect_pairs<WinogradTransform<6, 3>>();
  expect_pairs<WinogradTransform<7, 3>>();
  expect_pairs<WinogradTransform<6, 5>>();
}

template <class Transform>
void expect_exact_in_float() {
  for (const auto& row : Transform::kOutput)
    for (const double value : row) EXPECT_EQ(static_cast<float>(value), value);
  for (const auto& row : Transform::kInput)
    for (const double value : row) EXPECT_EQ(static_cast<float>(value), value);
}

/// A rounded constant would add an error to every tile.
TEST(WinogradTransform, ConstantsAreExactInFloat) {
  expect_exact_in_float<WinogradTransform<4, 3>>();
  expect_exact_in_float<WinogradTransform<5, 3>>();
  expect_exact_in_float<WinogradTransform<6, 3>>();
  expect_exact_in_float<WinogradTransform<7, 3>>();
  expect_exact_in_float<WinogradTransform<6, 5>>();
}

}  // namespace
}  // namespace revisit::engine
