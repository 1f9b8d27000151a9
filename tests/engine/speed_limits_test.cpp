// What layers multiply and move, and what the machine can do at most.
#include "revisit/engine/speed_limits.h"

#include <gtest/gtest.h>

#include <chrono>
#include <cstring>

#include "expect_error.h"
#include "kernels/blocked/convolution.h"
#include "kernels/gemm.h"
#include "net_case.h"

namespace revisit::engine {
namespace {

const LayerCost& cost_of(const Plan& plan, const std::string& name) {
  for (const LayerCost& layer : plan.layers())
    if (layer.name == name) return layer;
  throw std::runtime_error("no layer " + name);
}

TEST(LayerTraffic, IsWhatKernelsReadAndWriteOnce) {
  // Plain values; conv and relu are one kernel, Dropout moves nothing.
  const Net net = test::small_net(
      {1, 2, 6, 8},
      test::conv("conv", "data", "num_output: 3 kernel_size: 1") +
          test::in_place("relu", "ReLU", "conv") + test::in_place("drop", "Dropout", "conv") +
          "layer { name: 'pool' type: 'Pooling' bottom: 'conv' top: 'pool' pooling_param { "
          "kernel_size: 2 stride: 2 } }\n"
          "layer { name: 'ip' type: 'InnerProduct' bottom: 'pool' top: 'ip' inner_product_param { "
          "num_output: 5 } }\n",
      {}, test::Weights::kNone);
  const Plan plan = net.plan({}, {.reference_kernels = true});
  constexpr int64_t kFloat = 4;
  const auto expect = [&](const std::string& layer, int64_t read, int64_t written) {
    EXPECT_EQ(cost_of(plan, layer).read_bytes, kFloat * read) << layer;
    EXPECT_EQ(cost_of(plan, layer).written_bytes, kFloat * written) << layer;
  };
  expect("data", 0, 0);
  expect("conv", 2 * 6 * 8 + 3 * 2 + 3, 3 * 6 * 8);
  expect("drop", 0, 0);
  expect("pool", 3 * 6 * 8, 3 * 3 * 4);
  expect("ip", 3 * 3 * 4 + 5 * 36 + 5, 5);
  EXPECT_EQ(cost_of(plan, "conv").multiplications, cost_of(plan, "conv").macs);
  EXPECT_EQ(cost_of(plan, "ip").multiplications, 5 * 36);
  EXPECT_EQ(cost_of(plan, "pool").multiplications, 0);
}

TEST(LayerTraffic, EmbedReadsAFewRowsOfItsWeights) {
  const Net net = test::small_net(
      {3},
      "layer { name: 'embed' type: 'Embed' bottom: 'data' top: 'embed' embed_param { input_dim: "
      "1000 num_output: 7 bias_term: false } }\n",
      {}, test::Weights::kNone);
  const Plan plan = net.plan();
  EXPECT_EQ(cost_of(plan, "embed").read_bytes, 4 * (3 + 3 * 7));
}

TEST(Multiplications, WinogradNeedsFewerAndSaysHowMany) {
  // F(4x4,3x3) multiplies 6 x 6 numbers for 4 x 4 outputs of 9 products each.
  ConvolutionProblem p{1, 32, 24, 48, 64, 24, 48, 3, 3, 1, 1, 1, 1};
  for (const BlockedConvolutionKernel& kernel : blocked_convolution_kernels()) {
    if (!kernel.multiplications) continue;
    EXPECT_GT(kernel.transform_points, 0) << kernel.name;
    EXPECT_LT(kernel.multiplications(p), p.macs()) << kernel.name;
    if (std::strcmp(kernel.name, "winograd F(4x4,3x3)") == 0) {
      EXPECT_EQ(kernel.multiplications(p), p.macs() * 36 / (16 * 9));
    }
  }
  // Tiles at the border are whole.
  p.out_w = p.w = 45;
  for (const BlockedConvolutionKernel& kernel : blocked_convolution_kernels())
    if (std::strcmp(kernel.name, "winograd F(4x4,3x3)") == 0) {
      EXPECT_EQ(kernel.multiplications(p), 6 * 12 * 36 * 32 * 64);
    }
}

TEST(SpeedLimits, TimesAreByTheHigherRoofOfTheWorkingSet) {
  SpeedLimits limits;
  limits.float32_gflops = 100;
  limits.bf16_gflops = 200;
  limits.bandwidths = {{1000, 80, 40}, {1'000'000, 20, 10}};
  LayerCost cost;
  cost.multiplications = 50'000'000;
  EXPECT_DOUBLE_EQ(limits.compute_ms(cost), 1);
  cost.products = Precision::kBf16;
  EXPECT_DOUBLE_EQ(limits.compute_ms(cost), 0.5);
  limits.bf16_gflops = 0;
  EXPECT_DOUBLE_EQ(limits.compute_ms(cost), 1) << "without instructions";
  cost.read_bytes = 600'000, cost.written_bytes = 400'000;
  EXPECT_DOUBLE_EQ(limits.traffic_ms(cost), 0.8 / 10 + 0.2 / 20) << "copied, and the rest read";
  cost.read_bytes = 0, cost.written_bytes = 2'000'000;
  EXPECT_DOUBLE_EQ(limits.traffic_ms(cost), 2.0 / 10) << "beyond the largest";
  cost.read_bytes = 500, cost.written_bytes = 0;
  EXPECT_DOUBLE_EQ(limits.traffic_ms(cost), 500 / 80e6) << "below the smallest";
  cost.read_bytes = 31'623;  // halfway between the two, by ratios
  EXPECT_NEAR(limits.traffic_ms(cost), 31'623 / 50e6, 1e-8);
}

TEST(SpeedLimits, ThreadsAreChecked) {
  for (const int threads : {0, -1, 1025})
    test::expect_error<UsageError>([&] { measure_speed_limits(threads); },
                                   {"thread", str(threads)});
}

// Code of others reaches the limits, nearly, and does not exceed them. The bounds are wide: tests
// share their machine.
TEST(SpeedLimits, AreThoseOfThisMachine) {
#if !defined(__OPTIMIZE__) || defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)
  GTEST_SKIP() << "only optimised code comes near";
#endif
  using Clock = std::chrono::steady_clock;
  const auto fastest = [](int repeat, const auto& work) {
    double best = 1e9;
    for (int i = 0; i < repeat; ++i) {
      const auto begin = Clock::now();
      work();
      best = std::min(best, std::chrono::duration<double>(Clock::now() - begin).count());
    }
    return best;
  };
  const SpeedLimits limits = measure_speed_limits(1);
  constexpr int kSize = 384;
  const std::vector<float> a(size_t{kSize} * kSize, 0.5F);
  std::vector<float> c(a.size());
  const double product = fastest(20, [&] {  // by OpenBLAS
    gemm({kSize, kSize, kSize, a.data(), kSize, a.data(), kSize, false, c.data(), kSize});
  });
  const double gflops = 2e-9 * kSize * kSize * kSize / product;
  EXPECT_LT(gflops, 1.3 * limits.float32_gflops);
  EXPECT_GT(gflops, 0.1 * limits.float32_gflops);

  constexpr size_t kSlice = 4 << 20;
  constexpr int kSlices = 16;
  const std::vector<char> from(kSlices * kSlice, 1);
  std::vector<char> to(from.size());
  size_t first = 0;
  const double copy = fastest(2 * kSlices, [&] {
    std::memcpy(to.data() + first, from.data() + first, kSlice);
    first = (first + kSlice) % from.size();
  });
  const double copied = 2e-9 * kSlice / copy;
  EXPECT_LT(copied, 3 * limits.memory().copy);
  EXPECT_GT(copied, limits.memory().copy / 5);
  EXPECT_GE(limits.bandwidths.front().read, limits.memory().read);
  EXPECT_GE(limits.memory().bytes, 64 << 20);
}

}  // namespace
}  // namespace revisit::engine
