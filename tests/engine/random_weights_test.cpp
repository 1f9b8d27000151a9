#include "revisit/engine/net.h"
#include "testing.h"

namespace revisit::engine {
namespace {

Net alexnets_first_layer(uint64_t seed) {
  const TempDir dir;
  write_file(
      dir / "net.prototxt",
      "layer { name: 'data' type: 'Input' top: 'data' input_param { shape { dim: [1, 3, 227, 227] "
      "} } } layer { name: 'conv1' type: 'Convolution' bottom: 'data' top: 'conv1' "
      "convolution_param { num_output: 96 kernel_size: 11 stride: 4 } }");
  return Net::load_with_random_weights(dir / "net.prototxt", seed);
}

// Expected values come from a separate Python program, whose SplitMix64 was verified with the
// published first output for seed 0, e220a8397b1dcdaf.
TEST(RandomWeights, BitsAreTheDocumentedOnes) {
  const Net net = alexnets_first_layer(1);
  const auto weights = net.weights();
  ASSERT_EQ(weights.size(), 1U);
  ASSERT_EQ(weights[0].first, "conv1");
  ASSERT_EQ(weights[0].second.size(), 2U);
  const auto conv = weights[0].second[0].values(), bias = weights[0].second[1].values();
  ASSERT_EQ(conv.size(), 96U * 3 * 11 * 11);
  EXPECT_EQ(conv[0], 0x1.33c4fap-5F);
  EXPECT_EQ(conv[1], -0x1.12564ap-6F);
  EXPECT_EQ(conv[2], -0x1.348cf6p-4F);
  EXPECT_EQ(conv[34847], 0x1.19839cp-5F);
  ASSERT_EQ(bias.size(), 96U);
  EXPECT_EQ(bias[0], 0x1.b3a1d4p-8F);
  EXPECT_EQ(bias[95], -0x1.8b938cp-9F);
}

/// Moments relative to the expected standard deviation: for n independent Gaussians, mean
/// 0 +- 1/sqrt(n), variance 1 +- sqrt(2/n), kurtosis 3 +- sqrt(24/n).
TEST(RandomWeights, AreGaussianWithHesVariance) {
  const Net net = alexnets_first_layer(42);
  const auto values = net.weights()[0].second[0].values();
  const auto n = static_cast<double>(values.size());
  double sum = 0, squares = 0, fourths = 0;
  for (const float value : values) {
    const double x = value / std::sqrt(2.0 / (3 * 11 * 11));
    sum += x;
    squares += x * x;
    fourths += x * x * x * x;
  }
  EXPECT_NEAR(sum / n, 0, 5 / std::sqrt(n));
  EXPECT_NEAR(squares / n, 1, 5 * std::sqrt(2 / n));
  EXPECT_NEAR(fourths / n, 2.9, 5 * std::sqrt(96 / n));
}

}  // namespace
}  // namespace revisit::engine
