#include <sys/wait.h>
#include <unistd.h>

#include "net_case.h"
#include "testing.h"

namespace revisit::engine {
namespace {

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
    // Without the fused BatchNorm, the weights of c differ; those of d are equal.
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
  // `net inspect` reports the same size without weights as with them.
  const Net inspected = small_net({1, 16, 9, 11}, kTwo, {}, test::Weights::kNone);
  EXPECT_EQ(inspected.plan().packed_weight_bytes(), net_of_two().plan().packed_weight_bytes());
  EXPECT_EQ(inspected.packed_weight_bytes(), 0);
}

TEST(PackedWeights, PlansAndRunsOfOneNetInParallel) {
  const Net net = net_of_two();
  const auto result_of = [](const Plan& plan, unsigned seed) {
    engine::Run run(plan);
    test::fill_randomly(run, seed);
    run.forward();
    const auto values = run.output("d").values();
    return std::vector<float>(values.begin(), values.end());
  };
  const std::vector<Shape> shapes{{1, 16, 9, 11}, {1, 16, 9, 12}};
  std::vector<std::vector<float>> wanted;
  for (const Shape& shape : shapes) wanted.push_back(result_of(net.plan({{"data", shape}}), 7));
  std::vector<std::thread> threads;
  for (unsigned t = 0; t < 4; ++t)
    threads.emplace_back([&, t] {
      const Plan plan = net.plan({{"data", shapes[t % 2]}});
      for (int i = 0; i < 3; ++i) {
        EXPECT_EQ(result_of(net.plan({{"data", shapes[0]}}), 7), wanted[0]);
        EXPECT_EQ(result_of(plan, 7), wanted[t % 2]);
      }
    });
  for (std::thread& thread : threads) thread.join();
}

/// The child has only the forking thread and must not wait for locks of others.
TEST(Forked, PlansWhileAnotherThreadPlans) {
#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)
  GTEST_SKIP() << "a forked child waits for ever for the allocator of GCC's sanitizers";
#endif
  const Net net = net_of_two();
  std::atomic<bool> done = false;
  std::vector<std::jthread> planners;  // joined at the end, also on failure
  const struct Stop {
    std::atomic<bool>& done;
    ~Stop() { done = true; }
  } stop{done};
  for (int64_t t = 0; t < 2; ++t)
    planners.emplace_back([&, t] {
      while (!done) static_cast<void>(net.plan({{"data", Shape{1, 16, 9 + t, 11}}}));
    });
  for (int i = 0; i < 60; ++i) {
    const pid_t child = ::fork();
    if (child == 0) {
      ::alarm(20);
      static_cast<void>(net.plan());
      ::_exit(0);
    }
    int status = -1;
    EXPECT_EQ(::waitpid(child, &status, 0), child);
    ASSERT_EQ(status, 0) << "child " << i;
  }
}

TEST(PackedWeights, OnePlanOnSeveralThreads) {
  const Net net = net_of_two();
  const Plan plan = net.plan();
  const auto run_with = [&plan](unsigned seed) {
    engine::Run run(plan);
    test::fill_randomly(run, seed);
    std::vector<float> result;
    for (int i = 0; i < 5; ++i) {
      run.forward();
      const auto values = run.output("d").values();
      result.assign(values.begin(), values.end());
    }
    return result;
  };
  std::vector<std::vector<float>> wanted, found(4);
  for (unsigned t = 0; t < 4; ++t) wanted.push_back(run_with(t));
  EXPECT_NE(wanted[0], wanted[1]);
  std::vector<std::thread> threads;
  for (unsigned t = 0; t < 4; ++t) threads.emplace_back([&, t] { found[t] = run_with(t); });
  for (std::thread& thread : threads) thread.join();
  EXPECT_EQ(found, wanted);
}

}  // namespace
}  // namespace revisit::engine
