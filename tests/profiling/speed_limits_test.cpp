#include "kernels/nchw.h"
#include "revisit/profiling/profile.h"
#include "testing.h"

namespace revisit::profiling {
namespace {

TEST(SpeedLimits, TimesAreByTheHigherRoofOfTheWorkingSet) {
  SpeedLimits limits;
  limits.float32_gflops = 100;
  limits.bf16_gflops = 200;
  limits.bandwidths = {{1000, 80, 40}, {1'000'000, 20, 10}};
  engine::LayerCost cost;
  cost.multiplications = 50'000'000;
  EXPECT_DOUBLE_EQ(limits.compute_ms(cost), 1);
  cost.products = engine::Precision::kBf16;
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
    expect_error<UsageError>([&] { measure_speed_limits(threads); }, {"thread", str(threads)});
}

// OpenBLAS and memcpy() nearly reach the limits, and must not exceed them. Bounds are wide, because
// other programs may run.
TEST(SpeedLimits, AreThoseOfThisMachine) {
#if !defined(__OPTIMIZE__) || defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)
  GTEST_SKIP() << "only optimized code comes near";
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
    engine::gemm({kSize, kSize, kSize, a.data(), kSize, a.data(), kSize, false, c.data(), kSize});
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
  EXPECT_LT(copied, 3 * limits.bandwidths.back().copy);
  EXPECT_GT(copied, limits.bandwidths.back().copy / 5);
  EXPECT_GE(limits.bandwidths.front().read, limits.bandwidths.back().read);
  EXPECT_GE(limits.bandwidths.back().bytes, 64 << 20);
}

}  // namespace
}  // namespace revisit::profiling
