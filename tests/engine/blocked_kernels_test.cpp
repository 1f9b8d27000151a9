// Outputs are poisoned with NaN and scratch with 0xA5 bytes before each run.
#include "blocked.h"
#include "kernels/blocked/kernels.h"
#include "kernels/blocked/partition.h"
#include "layers/pooling_window.h"
#include "problems.h"
#include "simd_targets.h"
#include "single_layer.h"
#include "testing.h"

namespace revisit::engine {
namespace {

constexpr unsigned kKernelSeed = 20260722;
constexpr int kThreadCounts[] = {1, 2, 3, 7, 16};

/// NaN equals NaN.
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

/// Layout: `[n][c][pixels]`.
struct Result {
  int64_t n, c, pixels;
  int64_t scratch_floats = 0;
};

/// Returns the result of `run(threads, output, scratch)` in NCHW. Checks that padding lanes are
/// zero and that threads do not change results. `scratch_floats` is called per number of threads.
using RunKernel = std::function<void(int threads, float* output, float* scratch)>;
std::vector<float> result_of(const Result& r, const RunKernel& run,
                             const std::function<int64_t(int)>& scratch_floats = nullptr) {
  std::vector<float> first;
  for (const int threads : kThreadCounts) {
    test::AlignedFloats output(r.n * padded_channels(r.c) * r.pixels, test::kNanByte);
    test::AlignedFloats scratch(scratch_floats ? scratch_floats(threads) : 0, test::kDirtyByte);
    run(threads, output.data(), scratch.data());
    EXPECT_EQ(test::find_dirty_tail(r.n, r.c, r.pixels, output.values()), -1);
    std::vector<float> plain = test::to_plain(r.n, r.c, r.pixels, output.values());
    if (threads == kThreadCounts[0])
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
    const std::vector<float> plain = test::random_floats(n * c * pixels, kKernelSeed);
    const test::AlignedFloats blocked = test::to_blocked(n, c, pixels, plain);
    test::for_each_blocked_case([&, n = n, c = c, pixels = pixels] {
      for (const int threads : kThreadCounts) {
        const BlockedSize size{n, c, pixels, threads};
        test::AlignedFloats there(n * padded_channels(c) * pixels, test::kNanByte);
        reorder_to_nchwc(size, plain.data(), there.data());
        EXPECT_TRUE(same_bits(there.values(), blocked.values()));
        std::vector<float> back(plain.size(), NAN);
        reorder_to_nchw(size, blocked.data(), back.data());
        EXPECT_TRUE(same_bits(back, plain));
      }
    });
  }
}

std::vector<float> with_specials(int64_t count, unsigned seed) {
  std::vector<float> values = test::random_floats(count, seed);
  const float specials[] = {NAN, INFINITY, -INFINITY, 0.0F, -0.0F, FLT_MAX, -FLT_MAX};
  for (size_t i = 0; i < values.size(); i += 3) values[i] = specials[i / 3 % std::size(specials)];
  return values;
}

class BlockedPooling : public testing::TestWithParam<test::Named<test::BlockedPooling>> {};

TEST_P(BlockedPooling, GivesTheNumbersOfThePlainKernel) {
  const auto& [n, c, window] = GetParam().problem;
  SCOPED_TRACE(testing::Message() << "seed " << kKernelSeed);
  using Plain = std::function<void(const PoolingProblem&, const float*, float*)>;
  struct Pair {
    const char* name;
    Plain plain;
    void (*blocked)(const PoolingProblem&, int64_t, const void*, void*);
  };
  const Plain plain_max = [](const PoolingProblem& p, const float* in, float* out) {
    max_pool(p, in, out, nullptr);
  };
  const Result size{n, c, window.out_h * window.out_w};
  for (const Pair& pair : {Pair{"max", plain_max, blocked_max_pool},
                           Pair{"average", average_pool, blocked_average_pool}})
    for (const auto& fill : {test::random_floats, with_specials}) {
      SCOPED_TRACE(pair.name);
      const std::vector<float> input = fill(n * c * window.h * window.w, kKernelSeed);
      std::vector<float> wanted(static_cast<size_t>(n * c * size.pixels), NAN);
      pair.plain(window, input.data(), wanted.data());
      const auto blocked = test::to_blocked(n, c, window.h * window.w, input);
      test::for_each_blocked_case([&, c = c, window = window] {
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

/// Compares outputs separately, so that large ones do not hide errors of small ones.
TEST_P(BlockedLrn, AgreesWithTheDefinition) {
  const LrnProblem& p = GetParam().problem;
  SCOPED_TRACE(testing::Message() << "seed " << kKernelSeed);
  for (const float magnitude : {1e-3F, 1.0F, 300.0F}) {
    SCOPED_TRACE(magnitude);
    std::vector<float> input = test::random_floats(p.n * p.c * p.h * p.w, kKernelSeed);
    for (float& value : input) value *= magnitude;
    std::vector<float> wanted(input.size(), NAN);
    lrn_across_channels_reference(p, input.data(), wanted.data());
    test::for_each_blocked_case([&] {
      const std::vector<float> found = blocked_lrn_of(p, input);
      for (size_t i = 0; i < wanted.size(); ++i)
        ASSERT_LE(std::abs(static_cast<double>(found[i]) - wanted[i]),
                  1e-6 * std::abs(static_cast<double>(wanted[i])))
            << i;
    });
  }
}

INSTANTIATE_TEST_SUITE_P(Problems, BlockedLrn, testing::ValuesIn(test::lrn_problems()),
                         [](const auto& instance) { return test::test_name(instance.param); });

/// Powers out of float's range or undefined must match pow() of the definition.
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
      test::for_each_blocked_case([&] {
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
  SCOPED_TRACE(testing::Message() << "seed " << kKernelSeed);
  for (const float beta : {0.75F, 0.6F}) {
    const LrnProblem lrn{n, c, window.h, window.w, 5, 0.9F, beta, 1};
    const std::vector<float> input = with_specials(n * c * window.h * window.w, kKernelSeed);
    const auto blocked = test::to_blocked(n, c, window.h * window.w, input);
    test::for_each_blocked_case([&, n = n, c = c, window = window] {
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

struct FirstLayers {
  const char* name;
  ConvolutionProblem convolution;
  bool with_lrn;
  caffe::PoolingParameter pooling;
};

FirstLayers first_layers(const char* name, int64_t n, int64_t c_in, int64_t h, int64_t w,
                         int64_t c_out, std::array<int64_t, 3> kernel_stride_pad, bool with_lrn,
                         std::array<uint32_t, 3> pooling) {
  FirstLayers f{name, {}, with_lrn, {}};
  ConvolutionProblem& p = f.convolution;
  p.n = n, p.c_in = c_in, p.h = h, p.w = w, p.c_out = c_out;
  p.kernel_h = p.kernel_w = kernel_stride_pad[0];
  p.stride_h = p.stride_w = kernel_stride_pad[1];
  p.pad_h = p.pad_w = kernel_stride_pad[2];
  p.out_h = (h + 2 * p.pad_h - p.kernel_h) / p.stride_h + 1;
  p.out_w = (w + 2 * p.pad_w - p.kernel_w) / p.stride_w + 1;
  f.pooling.set_kernel_size(pooling[0]);
  f.pooling.set_stride(pooling[1]);
  f.pooling.set_pad(pooling[2]);
  return f;
}

TEST(BlockedConvolutionMaxPool, GivesTheBitsOfOneAfterTheOther) {
  for (const FirstLayers& f :
       {first_layers("alexnet", 1, 1, 67, 1100, 96, {11, 4, 0}, true, {3, 2, 0}),
        first_layers("vgg-cnn-s", 1, 3, 67, 400, 96, {7, 2, 0}, true, {3, 3, 0}),
        first_layers("places-cnds-8", 1, 1, 40, 700, 64, {7, 2, 1}, false, {3, 2, 0}),
        first_layers("tail-batch-pads", 2, 3, 13, 37, 20, {3, 1, 1}, true, {3, 2, 1}),
        first_layers("mnist", 1, 1, 28, 28, 20, {5, 1, 0}, false, {2, 2, 0}),
        first_layers("global", 2, 3, 31, 31, 20, {3, 2, 1}, true, {16, 1, 0}),
        first_layers("nearly-global", 1, 3, 20, 20, 20, {3, 1, 1}, true, {18, 1, 1}),
        first_layers("gaps", 1, 2, 30, 30, 17, {2, 1, 0}, true, {2, 4, 0}),
        first_layers("narrow", 3, 4, 9, 5, 5, {3, 1, 0}, false, {2, 1, 0})}) {
    SCOPED_TRACE(f.name);
    ConvolutionProblem c = f.convolution;
    const int64_t pixels = c.out_pixels(), channels = padded_channels(c.c_out);
    LrnProblem lrn{c.n, c.c_out, c.out_h, c.out_w, 5, 0.1F, 0.75F, 2};
    PoolingProblem pooling = PoolingWindow(f.pooling).problem({c.n, c.c_out, c.out_h, c.out_w});
    std::vector<float> input = with_specials(c.n * c.c_in * c.h * c.w, kKernelSeed);
    for (size_t i = 0; i < input.size(); ++i)
      if (i % 401 != 0 && !std::isfinite(input[i])) input[i] = 1;
    const std::vector<float> weights = test::random_floats(c.c_out * c.depth(), kKernelSeed + 1);
    test::AlignedFloats bias(channels, 0),
        packed(kBlockedPlainInput.packed_floats(c), test::kNanByte);
    bias.data()[1] = 0.5F;
    kBlockedPlainInput.pack(c, weights.data(), packed.data());
    const Epilogue relu{Epilogue::Activation::kRelu};

    test::for_each_blocked_case([&] {
      c.threads = pooling.threads = lrn.threads = 1;
      test::AlignedFloats scratch(kBlockedPlainInput.scratch_floats(c), test::kDirtyByte);
      test::AlignedFloats convolved(c.n * channels * pixels, test::kNanByte);
      kBlockedPlainInput.run(c, {input.data(), packed.data(), bias.data(), nullptr, relu,
                                 convolved.data(), scratch.data()});
      test::AlignedFloats wanted(c.n * channels * pooling.out_h * pooling.out_w, test::kNanByte);
      if (f.with_lrn) {
        test::AlignedFloats lrn_scratch(blocked_lrn_max_pool_scratch_floats(lrn, pooling),
                                        test::kDirtyByte);
        blocked_lrn_max_pool(lrn, pooling, convolved.data(), wanted.data(), lrn_scratch.data());
      } else {
        blocked_max_pool(pooling, c.c_out, convolved.data(), wanted.data());
      }
      const auto fused = [&](int threads) {
        ConvolutionMaxPool p{c, f.with_lrn ? &lrn : nullptr, pooling};
        p.convolution.threads = threads;
        return p;
      };
      const std::vector<float> found = result_of(
          {c.n, c.c_out, pooling.out_h * pooling.out_w},
          [&](int threads, float* output, float* fused_scratch) {
            blocked_convolution_max_pool(fused(threads), {input.data(), packed.data(), bias.data(),
                                                          nullptr, relu, output, fused_scratch});
          },
          [&](int threads) { return blocked_convolution_max_pool_scratch_floats(fused(threads)); });
      EXPECT_TRUE(same_bits(
          found, test::to_plain(c.n, c.c_out, pooling.out_h * pooling.out_w, wanted.values())));
    });
  }
}

/// Registers, and vectors per block: AVX-512, NEON, AVX2, and two smaller sets.
TEST(SumTile, FillsTheRegistersOfEveryTarget) {
  const auto is = [](SumTile tile, int blocks, int columns) {
    return tile.blocks == blocks && tile.columns == columns;
  };
  EXPECT_TRUE(is(sum_tile(32, 1), 2, 14));
  EXPECT_TRUE(is(sum_tile(32, 4), 1, 6));
  EXPECT_TRUE(is(sum_tile(16, 2), 1, 6));
  EXPECT_TRUE(is(sum_tile(16, 4), 1, 2));
  EXPECT_TRUE(is(sum_tile(16, 16), 1, 2));
}

TEST(PoolingPieces, EveryThreadHasOneAndOneThreadMakesNoRowTwice) {
  for (const FirstLayers& f :
       {first_layers("alexnet", 1, 3, 227, 227, 96, {11, 4, 0}, true, {3, 2, 0}),
        first_layers("mnist", 1, 1, 28, 28, 20, {5, 1, 0}, false, {2, 2, 0}),
        first_layers("global", 1, 3, 224, 224, 64, {7, 4, 3}, false, {56, 1, 0}),
        first_layers("batch", 5, 3, 224, 224, 64, {7, 4, 3}, false, {3, 2, 0})}) {
    SCOPED_TRACE(f.name);
    const ConvolutionProblem& c = f.convolution;
    const PoolingProblem pooling =
        PoolingWindow(f.pooling).problem({c.n, c.c_out, c.out_h, c.out_w});
    EXPECT_EQ(PoolingPieces(pooling, c.c_out, 1).count(), c.n);
    for (const int threads : {2, 3, 4, 7, 8, 16}) {
      SCOPED_TRACE(threads);
      const PoolingPieces pieces(pooling, c.c_out, threads);
      EXPECT_GE(pieces.count(), threads);
      const int64_t rounds = (pieces.count() + threads - 1) / threads;
      const int64_t fair = (c.n * c.out_h + threads - 1) / threads;
      EXPECT_LE(rounds * pieces.bands.widest(), fair + std::max<int64_t>(fair / 4, 1));
    }
  }
}

/// Sizes with and without padding lanes, of less and more than one work item.
const Result kSizes[] = {{1, 16, 1}, {2, 5, 37}, {1, 35, 1500}};

std::vector<float> layer_result(const Result& r, const std::string& type, const std::string& param,
                                const std::vector<std::vector<float>>& inputs,
                                const std::vector<std::vector<float>>& weights = {}) {
  test::SingleLayer layer{.type = type, .param = param, .weights = weights, .reference = true};
  for (const std::vector<float>& input : inputs)
    layer.inputs.push_back({{r.n, r.c, 1, r.pixels}, input});
  return test::run_layer(layer)[0].values;
}

/// Pads to full blocks with values that must not affect results.
test::AlignedFloats padded(const std::vector<float>& values) {
  test::AlignedFloats result(padded_channels(static_cast<int64_t>(values.size())),
                             test::kDirtyByte);
  std::copy(values.begin(), values.end(), result.data());
  return result;
}

void expect_close_to(const std::vector<float>& found, const std::vector<float>& wanted,
                     float tolerance) {
  ASSERT_EQ(found.size(), wanted.size());
  for (size_t i = 0; i < found.size(); ++i)
    if (std::isfinite(wanted[i]))
      EXPECT_NEAR(found[i], wanted[i], tolerance * std::max(1.0F, std::abs(wanted[i]))) << i;
    else
      EXPECT_TRUE(same({&found[i], 1}, {&wanted[i], 1})) << i;
}

TEST(BlockedActivation, AgreesWithTheLayers) {
  using Activation = Epilogue::Activation;
  for (const Result& r : kSizes) {
    const std::vector<float> slopes = test::random_floats(r.c, kKernelSeed + 1);
    const test::AlignedFloats padded_slopes = padded(slopes);
    struct Case {
      Epilogue epilogue;
      const char *type, *param;
      std::vector<std::vector<float>> weights = {};
    };
    for (const Case& c :
         {Case{{Activation::kRelu}, "ReLU", ""},
          Case{{Activation::kRelu, 0.25F}, "ReLU", "relu_param { negative_slope: 0.25 }"},
          Case{{Activation::kPrelu, 0, 0, 0, padded_slopes.data()}, "PReLU", "", {slopes}},
          Case{{Activation::kElu, 1.5F}, "ELU", "elu_param { alpha: 1.5 }"},
          Case{{Activation::kSigmoid}, "Sigmoid", ""},
          Case{{Activation::kSwish, 2}, "Swish", "swish_param { beta: 2 }"},
          Case{{Activation::kTanh}, "TanH", ""}, Case{{Activation::kBnll}, "BNLL", ""},
          Case{{Activation::kMish}, "Mish", ""},
          Case{{Activation::kClip, 0, -1, 6}, "Clip", "clip_param { min: -1 max: 6 }"}}) {
      SCOPED_TRACE(c.type);
      std::vector<float> input = with_specials(r.n * r.c * r.pixels, kKernelSeed);
      for (size_t i = 1; i < input.size(); i += 3) input[i] *= 20;
      auto wanted = layer_result(r, c.type, c.param, {input}, c.weights);
      for (size_t i = 0; i < input.size(); ++i)
        if (std::isnan(input[i])) wanted[i] = NAN;  // the layer Clip yields `min`
      const auto blocked = test::to_blocked(r.n, r.c, r.pixels, input);
      test::for_each_blocked_case([&] {
        expect_close_to(result_of(r,
                                  [&](int threads, float* output, float*) {
                                    blocked_activation({r.n, r.c, r.pixels, threads}, c.epilogue,
                                                       blocked.data(), output);
                                  }),
                        wanted, 5e-7F);
      });
    }
  }
}

/// Signed zeros, visible by 1 / x and signbit().
TEST(BlockedActivation, ZerosHaveTheSignOfTheLayers) {
  using Activation = Epilogue::Activation;
  const std::vector<float> input = {-1, -0.0F, 0, 1, -FLT_MAX, FLT_MAX, -1e-20F, 1e-20F};
  const std::vector<float> slopes = {0, 0, 0, 0, 0.25F, 0, -0.0F, 0};
  const Result r{1, std::ssize(input), 1};
  const auto blocked = test::to_blocked(r.n, r.c, r.pixels, input);
  const test::AlignedFloats padded_slopes = padded(slopes);
  const auto check = [&](const Epilogue& epilogue, const std::vector<float>& wanted) {
    test::for_each_blocked_case([&] {
      EXPECT_TRUE(same_bits(
          result_of(
              r,
              [&](int threads, float* output, float*) {
                blocked_activation({r.n, r.c, r.pixels, threads}, epilogue, blocked.data(), output);
              }),
          wanted));
    });
  };
  check({Activation::kRelu}, layer_result(r, "ReLU", "", {input}));
  check({Activation::kPrelu, 0, 0, 0, padded_slopes.data()},
        layer_result(r, "PReLU", "", {input}, {slopes}));
}

TEST(BlockedScale, AgreesWithTheLayers) {
  for (const Result& r : kSizes) {
    const std::vector<float> scale = test::random_floats(r.c, kKernelSeed + 1);
    const std::vector<float> shift = test::random_floats(r.c, kKernelSeed + 2);
    const test::AlignedFloats padded_scale = padded(scale), padded_shift = padded(shift);
    const std::vector<float> input = with_specials(r.n * r.c * r.pixels, kKernelSeed);
    const auto scaled =
        layer_result(r, "Scale", "scale_param { bias_term: true }", {input}, {scale, shift});
    const auto wanted = layer_result(r, "ReLU", "", {scaled});
    const auto blocked = test::to_blocked(r.n, r.c, r.pixels, input);
    test::for_each_blocked_case([&] {
      expect_close_to(result_of(r,
                                [&](int threads, float* output, float*) {
                                  blocked_scale({r.n, r.c, r.pixels, threads}, padded_scale.data(),
                                                padded_shift.data(), {Epilogue::Activation::kRelu},
                                                blocked.data(), output);
                                }),
                      wanted, 5e-7F);
    });
  }
}

TEST(BlockedEltwise, AgreesWithTheLayer) {
  using Operation = BlockedEltwise::Operation;
  constexpr size_t kInputs = 3;
  const float ones[kInputs] = {1, 1, 1}, some[kInputs] = {0.5F, 0, -2};
  struct Case {
    BlockedEltwise eltwise;
    const char* param;
  };
  for (const Result& r : kSizes) {
    std::vector<std::vector<float>> inputs;
    std::vector<test::AlignedFloats> blocked;
    std::vector<const float*> pointers;
    for (unsigned k = 0; k < kInputs; ++k) {
      inputs.push_back(test::random_floats(r.n * r.c * r.pixels, kKernelSeed + k));
      // NaN in one input at a time, and in two.
      for (size_t i = k; i < inputs[k].size(); i += 5) inputs[k][i] = NAN;
      blocked.push_back(test::to_blocked(r.n, r.c, r.pixels, inputs[k]));
    }
    for (const test::AlignedFloats& b : blocked) pointers.push_back(b.data());
    for (const Case& c : {Case{{Operation::kSum, ones}, "eltwise_param { operation: SUM }"},
                          Case{{Operation::kSum, some},
                               "eltwise_param { operation: SUM coeff: 0.5 coeff: 0 coeff: -2 }"},
                          Case{{Operation::kProduct}, "eltwise_param { operation: PROD }"},
                          Case{{Operation::kMaximum}, "eltwise_param { operation: MAX }"},
                          Case{{Operation::kSum, ones, {Epilogue::Activation::kRelu}}, ""}}) {
      SCOPED_TRACE(c.param);
      const bool relu = c.eltwise.epilogue.activation == Epilogue::Activation::kRelu;
      auto wanted = layer_result(r, "Eltwise", c.param, inputs);
      if (relu) wanted = layer_result(r, "ReLU", "", {wanted});
      test::for_each_blocked_case([&] {
        EXPECT_TRUE(same(
            result_of(r,
                      [&](int threads, float* output, float*) {
                        blocked_eltwise({r.n, r.c, r.pixels, threads}, c.eltwise, pointers, output);
                      }),
            wanted));
      });
      test::AlignedFloats copy = test::to_blocked(r.n, r.c, r.pixels, inputs[1]);
      const float* const aliased[kInputs] = {pointers[0], copy.data(), pointers[2]};
      blocked_eltwise({r.n, r.c, r.pixels, 2}, c.eltwise, aliased, copy.data());
      EXPECT_TRUE(same(test::to_plain(r.n, r.c, r.pixels, copy.values()), wanted));
    }
  }
}

}  // namespace
}  // namespace revisit::engine
