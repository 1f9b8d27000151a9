// Packed weights: one copy for all plans of a net, gone with the last of them.
#include <gtest/gtest.h>

#include <cmath>
#include <thread>

#include "net_case.h"

namespace revisit::engine {
namespace {

using test::conv;
using test::in_place;
using test::small_net;

const std::string kTwo = conv("c", "data") + in_place("b", "BatchNorm", "c") +
                         in_place("r", "PReLU", "c") + conv("d", "c");

Net net_of_two() {
  return small_net({1, 16, 9, 11}, kTwo);
}

TEST(PackedWeights, AreSharedByPlansAndGoWithThem) {
  const Net net = net_of_two();
  EXPECT_EQ(net.packed_weight_bytes(), 0);
  {
    const Plan plan = net.plan();
    const int64_t bytes = plan.packed_weight_bytes();
    EXPECT_GE(bytes, 4 * 9 * (16 * 32 + 32 * 32));
    EXPECT_EQ(net.packed_weight_bytes(), bytes);
    const Plan same = net.plan({}, {.threads = 2});
    EXPECT_EQ(net.packed_weight_bytes(), bytes);
    // Without the BatchNorm in them the weights of c are others; those of d are the same.
    const Plan kept = net.plan({}, {.keep_all = true});
    EXPECT_GT(net.packed_weight_bytes(), bytes);
    EXPECT_LT(net.packed_weight_bytes(), 2 * bytes);
    EXPECT_EQ(net.plan({}, {.reference_kernels = true}).packed_weight_bytes(), 0);
  }
  EXPECT_EQ(net.packed_weight_bytes(), 0);
  const engine::Run run(net.plan());
  EXPECT_EQ(net.packed_weight_bytes(), run.plan().packed_weight_bytes()) << "a run keeps its plan";
}

TEST(PackedWeights, OfALayerAreTheirShareOfTheSum) {
  const Plan plan = net_of_two().plan();
  int64_t sum = 0;
  for (const LayerCost& layer : plan.layers()) sum += layer.packed_weight_bytes;
  EXPECT_EQ(sum, plan.packed_weight_bytes());
}

TEST(PackedWeights, AreKnownWithoutWeights) {
  // What `net inspect` shows of a net without weights is what a run would hold.
  const Net inspected = small_net({1, 16, 9, 11}, kTwo, {}, test::Weights::kNone);
  EXPECT_EQ(inspected.plan().packed_weight_bytes(), net_of_two().plan().packed_weight_bytes());
  EXPECT_EQ(inspected.packed_weight_bytes(), 0);
}

TEST(PackedWeights, PlansAndRunsOfOneNetInParallel) {
  const Net net = net_of_two();
  const auto wanted = test::forward(net, {}).begin()->second.values;
  std::vector<std::thread> threads;
  for (unsigned t = 0; t < 4; ++t)
    threads.emplace_back([&net, &wanted, t] {
      const Plan plan = net.plan({{"data", Shape{1, 16, 9, 11 + t % 2}}});
      for (int i = 0; i < 3; ++i) {
        const auto found = test::forward(net, {}).begin()->second.values;
        EXPECT_EQ(found, wanted);
        engine::Run run(plan);
        std::fill_n(run.input("data").data, run.input("data").shape.elements(), 1.0F);
        run.forward();
        EXPECT_TRUE(std::isfinite(run.output("d").values()[0]));
      }
    });
  for (std::thread& thread : threads) thread.join();
}

TEST(PackedWeights, OnePlanOnSeveralThreads) {
  const Net net = net_of_two();
  const Plan plan = net.plan();
  const auto run_with = [&plan](float value) {
    engine::Run run(plan);
    std::fill_n(run.input("data").data, run.input("data").shape.elements(), value);
    std::vector<float> result;
    for (int i = 0; i < 5; ++i) {
      run.forward();
      const auto values = run.output("d").values();
      result.assign(values.begin(), values.end());
    }
    return result;
  };
  std::vector<std::vector<float>> wanted, found(4);
  for (int t = 0; t < 4; ++t) wanted.push_back(run_with(static_cast<float>(t) - 1.5F));
  std::vector<std::thread> threads;
  for (int t = 0; t < 4; ++t)
    threads.emplace_back([&, t] { found[t] = run_with(static_cast<float>(t) - 1.5F); });
  for (std::thread& thread : threads) thread.join();
  EXPECT_EQ(found, wanted);
}

}  // namespace
}  // namespace revisit::engine
