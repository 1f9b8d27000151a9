#include "net_case.h"
#include "single_layer.h"
#include "testing.h"

namespace revisit::engine {
namespace {

constexpr int64_t kMegabyte = 1 << 20;

std::string vgg_like() {
  const std::string param = "num_output: 64 kernel_size: 3 pad: 1";
  std::string layers = conv("c1", "data", param) + in_place("r1", "ReLU", "c1");
  for (int i = 2; i < 6; ++i) {
    const std::string name = "c" + std::to_string(i), before = "c" + std::to_string(i - 1);
    layers += conv(name, before, param) + in_place("b" + name, "BatchNorm", name) +
              in_place("r" + name, "ReLU", name);
  }
  return layers;
}

int64_t bytes_of(const Plan& plan) {
  return plan.arena_bytes() + plan.packed_weight_bytes();
}

std::ptrdiff_t memory_limited_layers(const Plan& plan) {
  return std::count_if(plan.layers().begin(), plan.layers().end(), [](const LayerCost& layer) {
    return layer.selection_reason == "memory limit";
  });
}

TEST(RunMemory, KernelsPackNothingWhereTheLimitIsTight) {
  const Net net = small_net({1, 3, 8, 8}, vgg_like());
  const Plan fastest = net.plan();
  ASSERT_GT(fastest.packed_weight_bytes(), fastest.weight_bytes());
  EXPECT_EQ(memory_limited_layers(fastest), 0);
  const int64_t limit = bytes_of(fastest);
  EXPECT_EQ(net.plan({}, {.max_run_bytes = limit}).packed_weight_bytes(),
            fastest.packed_weight_bytes());
  const Plan plan = test::expect_as_reference(net, {.max_run_bytes = limit - 1});
  EXPECT_LT(bytes_of(plan), limit);
  EXPECT_EQ(plan.packed_weight_bytes(), 0);
  EXPECT_EQ(memory_limited_layers(plan), 5);
  // Kernels do not depend on the number of threads.
  EXPECT_EQ(net.plan({}, {.threads = 2, .max_run_bytes = limit - 1}).packed_weight_bytes(), 0);
  expect_error<InputError>([&] { net.plan({}, {.max_run_bytes = 20 * 1024}); },
                           {"running the net takes", "MB for packed weights, in addition to",
                            "MB of weights", "raise the limit of a run"});
}

TEST(RunMemory, PartsOfABufferAreNotListedBesideIt) {
  const Plan plan =
      small_net({1, 16, 12, 16},
                "layer { name: 'cut' type: 'Slice' bottom: 'data' top: 'a' top: 'b' }" +
                    test::layer("ta", "TanH", {"a"}) + test::layer("tb", "TanH", {"b"}))
          .plan();
  std::vector<std::string> names;
  for (const BufferUse& buffer : plan.buffers()) names.push_back(buffer.what);
  EXPECT_EQ(names, (std::vector<std::string>{"data", "ta", "tb"}));
}

TEST(RunMemory, PackedWeightsBeyondAnyBudget) {
  const Net net =
      small_net({1, 4096, 112, 112}, conv("c", "data", "num_output: 4096 kernel_size: 3 pad: 1"),
                {}, test::Weights::kNone);
  const Plan plan = net.plan({}, {.max_run_bytes = 700 * kMegabyte});
  EXPECT_EQ(plan.weight_bytes() / kMegabyte, 576);
  EXPECT_LE(bytes_of(plan), 700 * kMegabyte);
  EXPECT_EQ(memory_limited_layers(plan), 1);
  expect_error<InputError>(
      [&] { net.plan({}, {.max_run_bytes = 300 * kMegabyte}); },
      {"running the net takes 401 MB", "MB for values and 0 MB for packed weights",
       "in addition to 576 MB of weights", "the limit of 300 MB"});
}

TEST(RunMemory, InputsThatAreNotFilledShow) {
  engine::Run run(small_net({1, 4}, test::layer("r", "ReLU", {"data"})).plan());
  for (const float x : run.input("data").values()) EXPECT_TRUE(std::isnan(x));
}

TEST(Moved, OnlyRunsCanBeMovedFrom) {
  Net net = small_net({1, 4}, test::layer("r", "ReLU", {"data"}));
  const Net other_net = std::move(net);
  Plan plan = net.plan();  // NOLINT(bugprone-use-after-move): a copy
  const Plan other_plan = std::move(plan);
  engine::Run run(plan);  // NOLINT(bugprone-use-after-move): a copy
  engine::Run other = std::move(run);
  // NOLINTBEGIN(bugprone-use-after-move): the test expects the exception
  const auto expect_refused = [](const auto& use) {
    expect_error<UsageError>(use, {"moved from"});
  };
  expect_refused([&] { run.input("data"); });
  expect_refused([&] { static_cast<void>(run.output("r")); });
  expect_refused([&] { static_cast<void>(run.layer_output("r")); });
  expect_refused([&] { run.forward([](size_t, bool) {}); });
  EXPECT_DEATH(run.forward(), "moved from");
  // NOLINTEND(bugprone-use-after-move)
  std::fill_n(other.input("data").data, 4, -2.0F);
  other.forward();
  EXPECT_EQ(other.output("r").values()[3], 0);
  run = std::move(other);
  run.forward();
}

}  // namespace
}  // namespace revisit::engine
