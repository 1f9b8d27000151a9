// Kernels on blocked values against the plain ones, whatever instructions the CPU has. Outputs are
// poisoned with NaN and scratch with 0xA5 bytes before each run.
#include <gtest/gtest.h>

#include <cfloat>
#include <cmath>
#include <functional>

#include "blocked.h"
#include "compare.h"
#include "kernels/blocked/lrn.h"
#include "kernels/blocked/pooling.h"
#include "kernels/blocked/reorder.h"
#include "problems.h"
#include "simd_targets.h"
#include "single_layer.h"

namespace revisit::engine {
namespace {

constexpr unsigned kSeed = 20260722;
constexpr unsigned char kNan = 0xFF, kDirty = 0xA5;
constexpr int kThreads[] = {1, 2, 3};

/// Equal as numbers; NaN equals NaN.
testing::AssertionResult same(std::span<const float> found, std::span<const float> wanted) {
  if (found.size() != wanted.size())
    return testing::AssertionFailure() << found.size() << " values instead of " << wanted.size();
  for (size_t i = 0; i < found.size(); ++i)
    if (found[i] != wanted[i] && !(std::isnan(found[i]) && std::isnan(wanted[i])))
      return testing::AssertionFailure()
             << "at " << i << ": " << found[i] << " instead of " << wanted[i];
  return testing::AssertionSuccess();
}

testing::AssertionResult same_bits(std::span<const float> found, std::span<const float> wanted) {
  if (found.size() == wanted.size() &&
      std::memcmp(found.data(), wanted.data(), found.size_bytes()) == 0)
    return testing::AssertionSuccess();
  return testing::AssertionFailure() << "not the same bits";
}

/// A value `[n][c][pixels]` as the result of a kernel.
struct Result {
  int64_t n, c, pixels;
  int64_t scratch_floats = 0;
};

/// The result of `run(threads, output, scratch)`, in plain layout, after checking that tails are
/// zero and that the number of threads does not matter. `scratch_floats` is asked for each number.
using Kernel = std::function<void(int threads, float* output, float* scratch)>;
std::vector<float> result_of(const Result& r, const Kernel& run,
                             const std::function<int64_t(int)>& scratch_floats = nullptr) {
  std::vector<float> first;
  for (const int threads : kThreads) {
    test::AlignedFloats output(r.n * padded_channels(r.c) * r.pixels, kNan);
    test::AlignedFloats scratch(scratch_floats ? scratch_floats(threads) : 0, kDirty);
    run(threads, output.data(), scratch.data());
    EXPECT_EQ(test::find_dirty_tail(r.n, r.c, r.pixels, output.values()), -1);
    std::vector<float> plain = test::to_plain(r.n, r.c, r.pixels, output.values());
    if (threads == kThreads[0])
      first = std::move(plain);
    else
      EXPECT_TRUE(same_bits(plain, first)) << threads << " threads";
  }
  return first;
}

TEST(BlockedReorder, EveryElementToItsPlaceAndBack) {
  for (const auto& [n, c, pixels] : {std::array<int64_t, 3>{1, 1, 1},
                                     {2, 3, 7},
                                     {1, 16, 64},
                                     {3, 37, 1029},
                                     {1, 60, 1024},
                                     {2, 32, 5}}) {
    SCOPED_TRACE(testing::Message() << n << " x " << c << " x " << pixels);
    const std::vector<float> plain = test::random_floats(n * c * pixels, kSeed);
    const test::AlignedFloats blocked = test::to_blocked(n, c, pixels, plain);
    test::for_each_simd_target([&, n = n, c = c, pixels = pixels] {
      for (const int threads : kThreads) {
        const BlockedSize size{n, c, pixels, threads};
        test::AlignedFloats there(n * padded_channels(c) * pixels, kNan);
        reorder_to_blocked(size, plain.data(), there.data());
        EXPECT_TRUE(same_bits(there.values(), blocked.values()));
        std::vector<float> back(plain.size(), NAN);
        reorder_to_plain(size, blocked.data(), back.data());
        EXPECT_TRUE(same_bits(back, plain));
      }
    });
  }
}

/// Random values, or every special one among them.
std::vector<float> with_specials(int64_t count, unsigned seed) {
  std::vector<float> values = test::random_floats(count, seed);
  const float specials[] = {NAN, INFINITY, -INFINITY, 0.0F, -0.0F, FLT_MAX, -FLT_MAX};
  for (size_t i = 0; i < values.size(); i += 3) values[i] = specials[i / 3 % std::size(specials)];
  return values;
}

class BlockedPooling : public testing::TestWithParam<test::Named<test::BlockedPooling>> {};

TEST_P(BlockedPooling, GivesTheNumbersOfThePlainKernel) {
  const auto& [n, c, window] = GetParam().problem;
  SCOPED_TRACE(testing::Message() << "seed " << kSeed);
  using Plain = std::function<void(const PoolingProblem&, const float*, float*)>;
  struct Pair {
    const char* name;
    Plain plain;
    void (*blocked)(const PoolingProblem&, int64_t, const float*, float*);
  };
  const Plain plain_max = [](const PoolingProblem& p, const float* in, float* out) {
    max_pool(p, in, out, nullptr);
  };
  const Result size{n, c, window.out_h * window.out_w};
  for (const Pair& pair : {Pair{"max", plain_max, blocked_max_pool},
                           Pair{"average", average_pool, blocked_average_pool}})
    for (const auto& fill : {test::random_floats, with_specials}) {
      SCOPED_TRACE(pair.name);
      const std::vector<float> input = fill(n * c * window.h * window.w, kSeed);
      std::vector<float> wanted(static_cast<size_t>(n * c * size.pixels), NAN);
      pair.plain(window, input.data(), wanted.data());
      const auto blocked = test::to_blocked(n, c, window.h * window.w, input);
      test::for_each_simd_target([&, c = c, window = window] {
        EXPECT_TRUE(same(result_of(size,
                                   [&](int threads, float* output, float*) {
                                     PoolingProblem p = window;
                                     p.threads = threads;
                                     pair.blocked(p, c, blocked.data(), output);
                                   }),
                         wanted));
      });
    }
}

INSTANTIATE_TEST_SUITE_P(Problems, BlockedPooling, testing::ValuesIn(test::pooling_problems()),
                         [](const auto& instance) { return test::test_name(instance.param); });

/// The result of blocked_lrn() for a plain input.
std::vector<float> blocked_lrn_of(const LrnProblem& problem, std::span<const float> input) {
  const auto blocked = test::to_blocked(problem.n, problem.c, problem.h * problem.w, input);
  const auto with = [&](int threads) {
    LrnProblem p = problem;
    p.threads = threads;
    return p;
  };
  return result_of(
      {problem.n, problem.c, problem.h * problem.w},
      [&](int threads, float* output, float* scratch) {
        blocked_lrn(with(threads), blocked.data(), output, scratch);
      },
      [&](int threads) { return blocked_lrn_scratch_floats(with(threads)); });
}

class BlockedLrn : public testing::TestWithParam<test::Named<LrnProblem>> {};

/// Each output by itself: the errors of small ones do not hide behind large ones.
TEST_P(BlockedLrn, AgreesWithTheDefinition) {
  const LrnProblem& p = GetParam().problem;
  SCOPED_TRACE(testing::Message() << "seed " << kSeed);
  for (const float magnitude : {1e-3F, 1.0F, 300.0F}) {
    SCOPED_TRACE(magnitude);
    std::vector<float> input = test::random_floats(p.n * p.c * p.h * p.w, kSeed);
    for (float& value : input) value *= magnitude;
    std::vector<float> wanted(input.size(), NAN);
    lrn_across_channels_reference(p, input.data(), wanted.data());
    test::for_each_simd_target([&] {
      const std::vector<float> found = blocked_lrn_of(p, input);
      double worst = 0;
      for (size_t i = 0; i < wanted.size(); ++i)
        worst = std::max(worst, std::abs(static_cast<double>(found[i]) - wanted[i]) /
                                    std::abs(static_cast<double>(wanted[i])));
      EXPECT_LE(worst, 1e-6);
    });
  }
}

INSTANTIATE_TEST_SUITE_P(Problems, BlockedLrn, testing::ValuesIn(test::lrn_problems()),
                         [](const auto& instance) { return test::test_name(instance.param); });

/// Where powers leave the range of float, or are none: what pow() of the definition gives.
TEST(BlockedLrn, SpecialValues) {
  for (const float beta : {0.75F, 0.6F}) {
    SCOPED_TRACE(beta);
    for (const float k : {0.0F, 1.0F, -1.0F}) {
      SCOPED_TRACE(k);
      const LrnProblem p{1, 18, 1, 9, 3, 3, beta, k};
      std::vector<float> input(static_cast<size_t>(p.c * p.w), 0.5F);
      const float rows[] = {NAN, INFINITY, -INFINITY, 0.0F, 1e25F, -1e25F, 1e-21F, 1e-23F, 0.25F};
      for (int64_t c = 0; c < p.c; ++c)
        for (int64_t x = 0; x < p.w; ++x)
          if (c % 4 == 0 || x == 3 || x == 6) input[static_cast<size_t>(c * p.w + x)] = rows[x];
      std::vector<float> wanted(input.size(), NAN);
      lrn_across_channels(p, input.data(), wanted.data());
      test::for_each_simd_target([&] {
        const std::vector<float> found = blocked_lrn_of(p, input);
        for (size_t i = 0; i < wanted.size(); ++i) {
          SCOPED_TRACE(i);
          if (std::isfinite(wanted[i]))
            EXPECT_NEAR(found[i], wanted[i], 2e-6 * std::abs(wanted[i]));
          else
            EXPECT_TRUE(same({&found[i], 1}, {&wanted[i], 1}));
        }
      });
    }
  }
}

class BlockedLrnMaxPool : public testing::TestWithParam<test::Named<test::BlockedPooling>> {};

TEST_P(BlockedLrnMaxPool, GivesTheBitsOfOneAfterTheOther) {
  const auto& [n, c, window] = GetParam().problem;
  SCOPED_TRACE(testing::Message() << "seed " << kSeed);
  for (const float beta : {0.75F, 0.6F}) {
    const LrnProblem lrn{n, c, window.h, window.w, 5, 0.9F, beta, 1};
    const std::vector<float> input = with_specials(n * c * window.h * window.w, kSeed);
    const auto blocked = test::to_blocked(n, c, window.h * window.w, input);
    test::for_each_simd_target([&, n = n, c = c, window = window] {
      const std::vector<float> between = blocked_lrn_of(lrn, input);
      std::vector<float> wanted(static_cast<size_t>(n * c * window.out_h * window.out_w), NAN);
      max_pool(window, between.data(), wanted.data(), nullptr);
      const auto with = [&](int threads) {
        PoolingProblem p = window;
        p.threads = threads;
        return p;
      };
      const std::vector<float> found = result_of(
          {n, c, window.out_h * window.out_w},
          [&](int threads, float* output, float* scratch) {
            blocked_lrn_max_pool(lrn, with(threads), blocked.data(), output, scratch);
          },
          [&](int threads) { return blocked_lrn_max_pool_scratch_floats(lrn, with(threads)); });
      EXPECT_TRUE(same(found, wanted));
    });
  }
}

INSTANTIATE_TEST_SUITE_P(Problems, BlockedLrnMaxPool, testing::ValuesIn(test::pooling_problems()),
                         [](const auto& instance) { return test::test_name(instance.param); });

}  // namespace
}  // namespace revisit::engine
