#include "revisit/profiling/profile.h"

#include "net_case.h"
#include "testing.h"

namespace revisit::profiling {
namespace {

TEST(Profile, OrderStatistics) {
  std::vector<double> samples;
  for (int i = 100; i >= 1; --i) samples.push_back(i);
  const Timing timing = summarize(samples);
  EXPECT_EQ(timing.min, 1);
  EXPECT_EQ(timing.median, 50.5);
  EXPECT_EQ(timing.p95, 95);
  EXPECT_EQ(summarize({7}).p95, 7);
  EXPECT_GE(timing.confidence, 0.99);
  EXPECT_EQ(summarize({7}).confidence, 0);
  EXPECT_NEAR(summarize({3, 1, 2}).confidence, 0.75, 1e-9);  // that not all are on one side
}

TEST(Profile, TimesEveryLayerAndTheWhole) {
  using namespace test;
  const engine::Net net = small_net(
      {1, 1, 100, 100}, conv("conv", "data") + in_place("relu", "ReLU", "conv") +
                            in_place("drop", "Dropout", "conv") + layer("tanh", "TanH", {"conv"}));
  engine::Run run(net.plan());
  std::ranges::fill(run.input("data").values(), 1.0F);
  const Profile result = profile(run, 1, 5);
  EXPECT_EQ(result.passes, 5);
  ASSERT_EQ(result.layers.size(), 5U);
  EXPECT_GT(result.layers[1].median, 0);
  EXPECT_EQ(result.layers[2].median, 0);  // the convolution does it
  EXPECT_EQ(result.layers[3].median, 0);  // Dropout: nothing runs
  EXPECT_GT(result.layers[4].median, 0);
  EXPECT_GT(result.total.min, 0);
  EXPECT_LE(result.total.min, result.total.median);
  EXPECT_LE(result.total.median, result.total.p95);
  EXPECT_GE(result.layer_sum.median, result.layers[1].min);
}

}  // namespace
}  // namespace revisit::profiling
