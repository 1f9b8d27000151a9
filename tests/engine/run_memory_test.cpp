// What a run takes: one limit for arena and packed weights, and the file's weights when kernels
// have copies of them.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <memory>
#include <thread>

#include "caffe_schema.pb.h"
#include "compare.h"
#include "expect_error.h"
#include "net_case.h"
#include "single_layer.h"
#include "test_data.h"

namespace revisit::engine {
namespace {

using test::conv;
using test::expect_error;
using test::in_place;
using test::small_net;

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

/// Of how many layers the limit chose the kernel.
std::ptrdiff_t limited(const Plan& plan) {
  return std::count_if(plan.layers().begin(), plan.layers().end(), [](const LayerCost& layer) {
    return layer.why == KernelReason::kMemoryLimit;
  });
}

TEST(RunMemory, KernelsPackWhatTheLimitLeaves) {
  const Net net = small_net({1, 3, 24, 24}, vgg_like());
  const Plan fastest = net.plan();
  ASSERT_GT(fastest.packed_weight_bytes(), fastest.weight_bytes());
  // With room for the scratch of three threads.
  const int64_t packed = fastest.packed_weight_bytes();
  const int64_t limit = net.plan({}, {.threads = 3}).arena_bytes() + 3 * packed / 4;
  const Plan plan = test::expect_as_reference(net, {.max_run_bytes = limit});
  EXPECT_LE(bytes_of(plan), limit);
  EXPECT_LT(plan.packed_weight_bytes(), packed);
  EXPECT_EQ(limited(fastest), 0);
  EXPECT_GT(limited(plan), 0);
  // The same kernels for any number of threads, or none.
  EXPECT_EQ(net.plan({}, {.threads = 2, .max_run_bytes = limit}).packed_weight_bytes(),
            plan.packed_weight_bytes());
  expect_error<InputError>(
      [&] { net.plan({}, {.max_run_bytes = 200 * 1024}); },
      {"running the net takes", "MB for packed weights, beside", "MB of weights", "max_run_bytes"});
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
  EXPECT_EQ(limited(plan), 1);
  expect_error<InputError>(
      [&] { net.plan({}, {.max_run_bytes = 300 * kMegabyte}); },
      {"running the net takes 401 MB", "MB for values and 0 MB for packed weights",
       "beside 576 MB of weights", "the limit of 300 MB"});
}

/// A net of vgg_like() in files.
class ReleasedWeights : public testing::Test {
 protected:
  ReleasedWeights() {
    test::write_file(prototxt(),
                     "layer { name: 'data' type: 'Input' top: 'data' input_param { "
                     "shape { dim: 1 dim: 3 dim: 24 dim: 24 } } }\n" +
                         vgg_like());
    caffe::NetParameter net;
    const auto add = [&](const std::string& name, const std::vector<std::vector<int64_t>>& shapes) {
      caffe::LayerParameter& layer = *net.add_layer();
      layer.set_name(name);
      for (const std::vector<int64_t>& shape : shapes) {
        caffe::BlobProto& blob = *layer.add_blobs();
        for (const int64_t size : shape) blob.mutable_shape()->add_dim(size);
        const auto seed = static_cast<unsigned>(net.layer_size());
        for (const float x : test::random_floats(Shape(shape).elements(), seed))
          blob.add_data(shape.size() == 4 ? 0.1F * x : 1.5F + x);
      }
    };
    for (int i = 1; i < 6; ++i) {
      const std::string name = "c" + std::to_string(i);
      add(name, {{64, i == 1 ? 3 : 64, 3, 3}, {64}});
      if (i > 1) add("b" + name, {{64}, {64}, {1}});
    }
    test::write_file(weights(), net.SerializeAsString());
  }

  std::filesystem::path prototxt() const { return dir_ / "net.prototxt"; }
  std::filesystem::path weights() const { return dir_ / "net.caffemodel"; }
  Net load(bool release = true) const {
    return Net::load(prototxt(), weights(), {.release_weights = release});
  }

  test::TempDir dir_;
};

std::vector<float> result(const Net& net, const PlanOptions& options = {}) {
  return test::forward(net, options).at("c5").values;
}

constexpr int64_t kOfConvolutions = 4 * (64 * 3 * 9 + 64 + 4 * (64 * 64 * 9 + 64));

TEST_F(ReleasedWeights, AreNotInMemoryBesideTheirCopies) {
  const Net kept = load(false), net = load();
  const int64_t all = kept.weight_bytes_in_memory();
  EXPECT_EQ(net.weight_bytes_in_memory(), all);
  {
    const Plan plan = net.plan(), same = kept.plan();
    EXPECT_EQ(net.weight_bytes_in_memory(), all - kOfConvolutions);
    EXPECT_EQ(kept.weight_bytes_in_memory(), all);
    EXPECT_EQ(plan.weight_bytes(), same.weight_bytes());
    EXPECT_EQ(plan.packed_weight_bytes(), same.packed_weight_bytes());
    EXPECT_EQ(result(net), result(kept));
  }
  EXPECT_EQ(net.packed_weight_bytes(), 0);
  EXPECT_EQ(result(net), result(kept)) << "packed again";
  EXPECT_EQ(net.weight_bytes_in_memory(), all - kOfConvolutions);
}

TEST_F(ReleasedWeights, AreReadAgainForOtherKernels) {
  const Net kept = load(false), net = load();
  const Plan first = net.plan();
  const PlanOptions reference{.reference_kernels = true};
  {
    const Plan second = net.plan({}, reference);
    EXPECT_EQ(net.weight_bytes_in_memory(), kept.weight_bytes_in_memory());
    EXPECT_EQ(result(net, reference), result(kept, reference));
  }
  EXPECT_EQ(net.weight_bytes_in_memory(), kept.weight_bytes_in_memory() - kOfConvolutions);
  EXPECT_EQ(result(net, {.keep_all = true}), result(kept, {.keep_all = true}));
}

TEST_F(ReleasedWeights, ReadAgainOnSeveralThreads) {
  const Net net = load();
  const std::vector<float> wanted = result(net);
  std::vector<std::thread> threads;
  for (int t = 0; t < 4; ++t)
    threads.emplace_back([&net, &wanted, t] {
      for (int i = 0; i < 3; ++i) {
        const auto found = result(net, {.reference_kernels = (t + i) % 2 == 0});
        EXPECT_LE(test::relative_error(found, wanted), 1e-4);
      }
    });
  for (std::thread& thread : threads) thread.join();
}

TEST_F(ReleasedWeights, AreNotReadFromAnotherFile) {
  const Net net = load();
  const std::vector<float> wanted = result(net);
  const std::string content = test::read_file(weights());
  const auto changed = std::filesystem::last_write_time(weights());
  const auto expect_refused = [&](const std::string& part) {
    expect_error<InputError>([&] { net.plan(); }, {"net.caffemodel", part});
  };
  test::write_file(weights(), content + content);
  expect_refused("changed since the net was loaded; layer 'c1'");
  test::write_file(weights(), content);
  std::filesystem::last_write_time(weights(), changed + std::chrono::seconds(1));
  expect_refused("without release_weights");
  std::filesystem::remove(weights());
  expect_refused("changed since");
  test::write_file(weights(), content);
  std::filesystem::last_write_time(weights(), changed);
  EXPECT_EQ(result(net), wanted);
}

TEST(RunMemory, InputsThatAreNotFilledShow) {
  engine::Run run(small_net({1, 4}, test::layer("r", "ReLU", {"data"})).plan());
  for (const float x : run.input("data").values()) EXPECT_TRUE(std::isnan(x));
}

/// Only inputs and outputs are lost to another run in the same arena.
TEST(RunMemory, WhatAnLstmRemembersIsEachRunsOwn) {
  const Net net =
      small_net({2, 1, 4},
                "layer { name: 'cont' type: 'Input' top: 'cont' input_param { shape { dim: 2 dim: "
                "1 } } }" +
                    test::layer("l", "LSTM", {"data", "cont"},
                                "recurrent_param { num_output: 3 weight_filler { type: 'xavier' } "
                                "}"));
  const Plan plan = net.plan();
  std::vector<float> memory(static_cast<size_t>(plan.arena_bytes()) / sizeof(float) + 16);
  void* begin = memory.data();
  size_t bytes = memory.size() * sizeof(float);
  ASSERT_TRUE(std::align(64, static_cast<size_t>(plan.arena_bytes()), begin, bytes));
  const std::span<std::byte> arena(static_cast<std::byte*>(begin), bytes);
  engine::Run alone(plan), shared(plan, arena), other(plan, arena);
  const auto pass = [](engine::Run& run, float x) {
    std::ranges::fill(run.input("data").values(), x);
    std::ranges::fill(run.input("cont").values(), 1.0F);
    run.forward();
    const auto found = run.output("l").values();
    return std::vector<float>(found.begin(), found.end());
  };
  const std::vector<float> first = pass(alone, 0.5F), second = pass(alone, 0.5F);
  EXPECT_NE(first, second);
  EXPECT_EQ(pass(shared, 0.5F), first);
  pass(other, -3);
  EXPECT_EQ(pass(shared, 0.5F), second);
}

class NoObserver : public StepObserver {
  void before(size_t) override {}
  void after(size_t) override {}
};

TEST(Moved, OnlyRunsCanBeMovedFrom) {
  Net net = small_net({1, 4}, test::layer("r", "ReLU", {"data"}));
  const Net other_net = std::move(net);
  Plan plan = net.plan();  // NOLINT(bugprone-use-after-move): a copy
  const Plan other_plan = std::move(plan);
  engine::Run run(plan);  // NOLINT(bugprone-use-after-move): a copy
  engine::Run other = std::move(run);
  // NOLINTBEGIN(bugprone-use-after-move): that it throws is what is tested
  const auto expect_refused = [](const auto& use) {
    expect_error<UsageError>(use, {"moved from"});
  };
  NoObserver observer;
  expect_refused([&] { run.input("data"); });
  expect_refused([&] { static_cast<void>(run.output("r")); });
  expect_refused([&] { static_cast<void>(run.layer_output("r")); });
  expect_refused([&] { run.forward(observer); });
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
