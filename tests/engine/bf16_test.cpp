#include <bit>

#include "blocked.h"
#include "kernels/blocked/kernels.h"
#include "kernels/blocked/partition.h"
#include "layout.h"
#include "net_case.h"
#include "problems.h"
#include "revisit/engine/machine.h"
#include "simd_targets.h"
#include "single_layer.h"
#include "testing.h"

namespace revisit::engine {
namespace {

constexpr unsigned kBf16Seed = 20261123;
constexpr float kStep = 1.0F / 256;  // maximum distance of neighbors around 1

TEST(BFloat16, IsTheNearestOfTwo) {
  const auto bits = [](float x) { return to_bfloat16(x).bits; };
  EXPECT_EQ(bits(1), 0x3F80);
  EXPECT_EQ(bits(-2.5F), 0xC020);
  EXPECT_EQ(bits(1 + kStep), 0x3F80);      // half way: to the even one
  EXPECT_EQ(bits(1 + 3 * kStep), 0x3F82);  // half way: to the even one
  EXPECT_EQ(bits(std::nextafter(1 + kStep, 2.0F)), 0x3F81);
  EXPECT_EQ(bits(0.0F), 0);
  EXPECT_EQ(bits(-0.0F), 0x8000);
  EXPECT_EQ(bits(INFINITY), 0x7F80);
  EXPECT_EQ(bits(3.4e38F), 0x7F80);
  EXPECT_EQ(bits(1e-40F), 0x0001);
  for (const uint32_t nan : {0x7F800001U, 0xFFFFFFFFU, 0x7FC00000U})
    EXPECT_TRUE(std::isnan(to_float(to_bfloat16(std::bit_cast<float>(nan))))) << nan;
  for (const float x : random_floats(1000, kBf16Seed)) {
    const float y = to_float(to_bfloat16(x));
    EXPECT_LE(std::abs(x - y), std::abs(x) * kStep);
    EXPECT_EQ(bits(y), bits(x));
  }
}

testing::AssertionResult same_bits(const test::AlignedFloats& a, const test::AlignedFloats& b) {
  if (a.values().size() == b.values().size() &&
      std::memcmp(a.data(), b.data(), a.values().size_bytes()) == 0)
    return testing::AssertionSuccess();
  return testing::AssertionFailure() << "not the same bits";
}

/// An NCHWc value that is exact in BFloat16, in both types.
struct BothWays {
  test::AlignedFloats bf16, float32;

  explicit BothWays(test::AlignedFloats blocked)
      : bf16(test::rounded_to_bf16(blocked)), float32(test::widened(bf16)) {}
  BothWays(int64_t n, int64_t c, int64_t pixels, unsigned seed)
      : BothWays(test::to_blocked(n, c, pixels, random_floats(n * c * pixels, seed))) {}

  const float* of(Precision precision) const {
    return (precision == Precision::kBf16 ? bf16 : float32).data();
  }
};

test::AlignedFloats nan_buffer(int64_t count, Precision precision) {
  return {precision == Precision::kBf16 ? count / 2 : count, test::kNanByte};
}

/// Checks that `run(precision, output)` writes the rounded float32 results in bfloat16, because the
/// kernel computes in float32. Both use the same target, because roots differ between targets.
void expect_rounded(int64_t count, const std::function<void(Precision, float*)>& run) {
  test::for_each_blocked_case([&](const test::SimdCase& c) {
    test::AlignedFloats wide = nan_buffer(count, Precision::kFloat32);
    {
      const test::ForceSimdTarget same(test::bf16_target(c));
      run(Precision::kFloat32, wide.data());
    }
    std::replace(wide.data(), wide.data() + count, -FLT_MAX, empty_maximum(Precision::kBf16));
    test::AlignedFloats narrow = nan_buffer(count, Precision::kBf16);
    run(Precision::kBf16, narrow.data());
    EXPECT_TRUE(same_bits(narrow, test::rounded_to_bf16(wide)));
  });
}

TEST(Bf16Kernels, PoolingRoundsOnce) {
  for (const auto& [name, problem] : test::pooling_problems()) {
    SCOPED_TRACE(name);
    const auto& [n, c, window] = problem;
    const BothWays input(n, c, window.h * window.w, kBf16Seed);
    for (auto* const pool : {blocked_max_pool, blocked_average_pool})
      expect_rounded(n * padded_channels(c) * window.out_h * window.out_w,
                     [&, c = c, window = window](Precision precision, float* output) {
                       PoolingProblem p = window;
                       p.values = precision;
                       p.threads = 2;
                       pool(p, c, input.of(precision), output);
                     });
  }
}

TEST(Bf16Kernels, NormalizationRoundsOnceAlsoWithPooling) {
  for (const auto& [name, problem] : test::lrn_problems()) {
    SCOPED_TRACE(name);
    const BothWays input(problem.n, problem.c, problem.h * problem.w, kBf16Seed);
    const auto with = [&p = problem](Precision precision) {
      LrnProblem lrn = p;
      lrn.values = precision;
      return lrn;
    };
    expect_rounded(problem.n * padded_channels(problem.c) * problem.h * problem.w,
                   [&](Precision precision, float* output) {
                     const LrnProblem p = with(precision);
                     test::AlignedFloats scratch(blocked_lrn_scratch_floats(p), test::kDirtyByte);
                     blocked_lrn(p, input.of(precision), output, scratch.data());
                   });
    PoolingProblem pooling;
    pooling.planes = problem.n * problem.c;
    pooling.h = problem.h, pooling.w = problem.w;
    pooling.kernel_h = std::min<int64_t>(3, problem.h);
    pooling.kernel_w = std::min<int64_t>(2, problem.w);
    pooling.out_h = problem.h - pooling.kernel_h + 1;
    pooling.out_w = problem.w - pooling.kernel_w + 1;
    expect_rounded(problem.n * padded_channels(problem.c) * pooling.out_h * pooling.out_w,
                   [&](Precision precision, float* output) {
                     const LrnProblem p = with(precision);
                     test::AlignedFloats scratch(blocked_lrn_max_pool_scratch_floats(p, pooling),
                                                 test::kDirtyByte);
                     blocked_lrn_max_pool(p, pooling, input.of(precision), output, scratch.data());
                   });
  }
}

TEST(Bf16Kernels, ElementwiseRoundsOnce) {
  const int64_t n = 2, c = 35, pixels = 700, count = n * padded_channels(c) * pixels;
  const BothWays a(n, c, pixels, kBf16Seed), b(n, c, pixels, kBf16Seed + 1);
  const auto scale = test::to_blocked(1, c, 1, random_floats(c, kBf16Seed + 2));
  const Epilogue leaky{.activation = Epilogue::Activation::kRelu, .slope = 0.3F};
  const auto size = [&](Precision precision) { return BlockedSize{n, c, pixels, 2, precision}; };
  expect_rounded(count, [&](Precision precision, float* output) {
    blocked_activation(size(precision), leaky, a.of(precision), output);
  });
  expect_rounded(count, [&](Precision precision, float* output) {
    blocked_scale(size(precision), scale.data(), scale.data(), leaky, a.of(precision), output);
  });
  const std::vector<float> coefficients = {0.7F, -1.3F, 0.1F};
  using Operation = BlockedEltwise::Operation;
  for (const Operation operation : {Operation::kSum, Operation::kProduct, Operation::kMaximum})
    expect_rounded(count, [&](Precision precision, float* output) {
      const std::vector<const float*> inputs = {a.of(precision), b.of(precision), a.of(precision)};
      blocked_eltwise(size(precision), {operation, coefficients, leaky}, inputs, output);
    });
}

TEST(Bf16Kernels, ReorderRoundsThereAndIsExactBack) {
  for (const auto& [n, c, pixels] :
       {std::array<int64_t, 3>{1, 1, 1}, {2, 3, 7}, {1, 16, 64}, {3, 37, 1029}, {2, 32, 65}}) {
    SCOPED_TRACE(testing::Message() << n << " x " << c << " x " << pixels);
    const std::vector<float> plain = random_floats(n * c * pixels, kBf16Seed);
    const BothWays value(test::to_blocked(n, c, pixels, plain));
    expect_rounded(n * padded_channels(c) * pixels,
                   [&, n = n, c = c, pixels = pixels](Precision precision, float* output) {
                     reorder_to_nchwc({n, c, pixels, 2, precision}, plain.data(), output);
                   });
    test::for_each_blocked_case([&, n = n, c = c, pixels = pixels] {
      std::vector<float> back(plain.size(), NAN);
      reorder_to_nchw({n, c, pixels, 2, Precision::kBf16}, value.bf16.data(), back.data());
      EXPECT_EQ(back, test::to_plain(n, c, pixels, value.float32.values()));
    });
  }
}

/// A convolution with input, weights and addend that are exact in BFloat16.
struct Bf16Case {
  ConvolutionProblem p;
  std::vector<float> plain, weights;
  BothWays input, addend;
  test::AlignedFloats bias;

  explicit Bf16Case(const ConvolutionProblem& problem)
      : p(problem),
        plain(random_floats(p.n * p.c_in * p.h * p.w, kBf16Seed)),
        weights(random_floats(p.c_out * p.depth(), kBf16Seed + 1)),
        input(test::to_blocked(p.n, p.c_in, p.h * p.w, plain)),
        addend(p.n, p.c_out, p.out_pixels(), kBf16Seed + 2),
        bias(test::to_blocked(1, p.c_out, 1, random_floats(p.c_out, kBf16Seed + 3))) {
    for (std::vector<float>* values : {&plain, &weights})
      for (float& x : *values) x = to_float(to_bfloat16(x));
  }

  int64_t outputs() const { return p.n * padded_channels(p.c_out) * p.out_pixels(); }

  void run(const BlockedConvolutionKernel& kernel, Precision precision, int threads,
           float* output) const {
    ConvolutionProblem q = p;
    q.values = precision;
    q.threads = threads;
    ASSERT_TRUE(kernel.supports(q));
    test::AlignedFloats packed(kernel.packed_floats(q), test::kNanByte);
    kernel.pack(q, weights.data(), packed.data());
    test::AlignedFloats scratch(kernel.scratch_floats(q), test::kDirtyByte);
    kernel.run(q, {kernel.input == Layout::kNchw ? plain.data() : input.of(precision),
                   packed.data(),
                   bias.data(),
                   addend.of(precision),
                   {.activation = Epilogue::Activation::kRelu, .slope = 0.1F},
                   output,
                   scratch.data()});
  }
};

/// Tolerance for the rounding of the result and for another order of summation.
void expect_close(const test::AlignedFloats& bf16, const test::AlignedFloats& wanted) {
  const test::AlignedFloats found = test::widened(bf16);
  float largest = 0;
  for (const float x : wanted.values()) largest = std::max(largest, std::abs(x));
  for (size_t i = 0; i < found.values().size(); ++i)
    ASSERT_LE(std::abs(found.values()[i] - wanted.values()[i]),
              std::abs(wanted.values()[i]) * kStep + largest * 5e-6F)
        << i;
}

class Bf16Convolution : public testing::TestWithParam<test::NamedConvolution> {};

/// Kernels that compute in float32 round once. For the others, products of two bfloat16 are exact
/// and sums are in float32 in another order. Their results are bitwise equal with every instruction
/// set, including those for bfloat16, and for any number of threads.
TEST_P(Bf16Convolution, IsThatOfFloat32Rounded) {
  const Bf16Case c(GetParam().problem);
  for (const BlockedConvolutionKernel& kernel : blocked_convolution_kernels()) {
    ConvolutionProblem narrow = c.p;
    narrow.values = Precision::kBf16;
    if (!kernel.supports(narrow)) continue;
    SCOPED_TRACE(kernel.name);
    if (kernel.products == Products::kFloat32) {
      expect_rounded(c.outputs(), [&](Precision precision, float* output) {
        c.run(kernel, precision, 2, output);
      });
      continue;
    }
    test::AlignedFloats wanted = nan_buffer(c.outputs(), Precision::kFloat32);
    c.run(kernel.supports(c.p) ? kernel : kBlockedDirect, Precision::kFloat32, 1, wanted.data());
    test::AlignedFloats first = nan_buffer(c.outputs(), Precision::kBf16);
    c.run(kernel, Precision::kBf16, 1, first.data());
    expect_close(first, wanted);
    test::for_each_blocked_case([&] {
      for (const int threads : {1, 3}) {
        test::AlignedFloats again = nan_buffer(c.outputs(), Precision::kBf16);
        c.run(kernel, Precision::kBf16, threads, again.data());
        EXPECT_TRUE(same_bits(again, first)) << threads << " threads";
      }
    });
  }
}

/// TDPBF16PS by Intel's manual, for one output: of every 32 inputs, even and odd ones are summed
/// separately from zero, both sums are added, then the result.
float sum_in_tiles(const std::vector<float>& inputs, const std::vector<float>& weights) {
  float sum = 0;
  for (size_t first = 0; first < inputs.size(); first += 32) {
    float even = 0, odd = 0;
    for (size_t i = first; i < std::min(first + 32, inputs.size()); ++i)
      (i % 2 == 0 ? even : odd) = std::fma(inputs[i], weights[i], i % 2 == 0 ? even : odd);
    sum += even + odd;
  }
  return sum;
}

TEST_P(Bf16Convolution, InTilesSumsAsAmxDoes) {
  ConvolutionProblem p = GetParam().problem;
  p.values = Precision::kBf16;
  if (!kBlockedTiles.supports(p)) GTEST_SKIP() << "groups that share blocks";
  const Bf16Case c(p);
  test::AlignedFloats packed(kBlockedTiles.packed_floats(p), test::kNanByte);
  kBlockedTiles.pack(p, c.weights.data(), packed.data());
  test::AlignedFloats scratch(kBlockedTiles.scratch_floats(p), test::kDirtyByte);
  test::AlignedFloats bias(padded_channels(p.c_out), 0), output = nan_buffer(c.outputs(), p.values);
  kBlockedTiles.run(p, {c.input.of(p.values),
                        packed.data(),
                        bias.data(),
                        nullptr,
                        {},
                        output.data(),
                        scratch.data()});
  const std::vector<float> found =
      test::to_plain(p.n, p.c_out, p.out_pixels(), test::widened(output).values());

  const int64_t depth = channel_blocks(p.c_in_per_group()) * p.kernel_h * p.kernel_w * kLanes;
  std::vector<float> inputs(depth), weights(depth);
  for (int64_t at = 0; at < static_cast<int64_t>(found.size()); ++at) {
    const int64_t x = at % p.out_w, y = at / p.out_w % p.out_h, co = at / p.out_pixels() % p.c_out,
                  n = at / p.out_pixels() / p.c_out;
    const int64_t group = co / p.c_out_per_group();
    for (int64_t i = 0; i < depth; ++i) {
      const int64_t kx = i / kLanes % p.kernel_w, ky = i / kLanes / p.kernel_w % p.kernel_h;
      const int64_t ci = i / kLanes / p.kernel_w / p.kernel_h * kLanes + i % kLanes;
      const int64_t iy = y * p.stride_h - p.pad_h + ky * p.dilation_h;
      const int64_t ix = x * p.stride_w - p.pad_w + kx * p.dilation_w;
      const bool there = ci < p.c_in_per_group() && iy >= 0 && iy < p.h && ix >= 0 && ix < p.w;
      const int64_t channel = group * p.c_in_per_group() + ci;
      inputs[i] = there ? c.plain[((n * p.c_in + channel) * p.h + iy) * p.w + ix] : 0;
      weights[i] =
          there ? c.weights[((co * p.c_in_per_group() + ci) * p.kernel_h + ky) * p.kernel_w + kx]
                : 0;
    }
    ASSERT_EQ(found[at], to_float(to_bfloat16(sum_in_tiles(inputs, weights)))) << at;
  }
}

/// Small enough for slow instructions, too.
std::vector<test::NamedConvolution> problems_in_bf16() {
  auto problems = test::convolution_problems();
  std::erase_if(problems, [](const auto& named) { return named.problem.macs() > 8'000'000; });
  return problems;
}

INSTANTIATE_TEST_SUITE_P(Problems, Bf16Convolution, testing::ValuesIn(problems_in_bf16()),
                         [](const auto& instance) { return test::test_name(instance.param); });

TEST(Bf16Kernels, FirstConvolutionWithPoolingRoundsItsOutputOnce) {
  for (const bool with_lrn : {false, true}) {
    ConvolutionProblem p;
    p.c_in = 3, p.h = 33, p.w = 61, p.c_out = 20, p.kernel_h = p.kernel_w = 5, p.stride_h = 2,
    p.stride_w = 2, p.out_h = 15, p.out_w = 29;
    const LrnProblem lrn{1, p.c_out, p.out_h, p.out_w, 5, 0.1F, 0.75F, 2};
    PoolingProblem pooling{p.c_out, p.out_h, p.out_w, 7, 14, 3, 3, 2, 2};
    const Bf16Case c(p);
    const auto run = [&](Precision precision, int threads, bool in_tiles = false) {
      ConvolutionMaxPool fused{p, with_lrn ? &lrn : nullptr, pooling, in_tiles};
      fused.convolution.values = precision;
      fused.convolution.threads = threads;
      test::AlignedFloats packed(kBlockedPlainInput.packed_floats(fused.convolution),
                                 test::kNanByte);
      kBlockedPlainInput.pack(fused.convolution, c.weights.data(), packed.data());
      test::AlignedFloats scratch(blocked_convolution_max_pool_scratch_floats(fused),
                                  test::kDirtyByte);
      test::AlignedFloats output =
          nan_buffer(padded_channels(p.c_out) * pooling.out_h * pooling.out_w, precision);
      blocked_convolution_max_pool(fused, {c.plain.data(),
                                           packed.data(),
                                           c.bias.data(),
                                           nullptr,
                                           {.activation = Epilogue::Activation::kRelu},
                                           output.data(),
                                           scratch.data()});
      return output;
    };
    const test::AlignedFloats wanted = run(Precision::kFloat32, 1);
    for (const bool in_tiles : {false, true}) {
      const test::AlignedFloats first = run(Precision::kBf16, 1, in_tiles);
      expect_close(first, wanted);
      test::for_each_blocked_case([&] {
        expect_close(run(Precision::kBf16, 1, in_tiles), wanted);
        if (with_lrn) return;  // roots differ by a bit between CPUs
        EXPECT_TRUE(same_bits(run(Precision::kBf16, 5, in_tiles), first));
      });
    }
  }
}

/// Constants of a single-channel input outside the image are in float32, as in the full net.
TEST(Bf16Nets, TakeAGrayInput) {
  const Net net = test::small_net({1, 3, 20, 33},
                                  test::conv("a", "data", "num_output: 32 kernel_size: 3 pad: 1") +
                                      test::conv("i", "a", "num_output: 32 kernel_size: 1"));
  const std::vector<float> offsets = {0, 3, -2};
  const auto output = [&](Precision precision) {
    engine::Run run(net.plan({}, {.precision = precision, .channel_offsets = offsets}));
    const std::vector<float> values = random_floats(20 * 33, kBf16Seed);
    std::copy(values.begin(), values.end(), run.input("data").data);
    run.forward();
    const View<const float> found = run.output("i");
    return std::vector<float>(found.data, found.data + found.shape.elements());
  };
  EXPECT_LT(relative_error(output(Precision::kBf16), output(Precision::kFloat32)), 2e-2);
}

TEST(Bf16Kernels, InnerProductIsThatOfTheRoundedWeights) {
  for (const auto& [name, p] : test::inner_product_problems()) {
    if (!p.has_few_inputs()) continue;
    SCOPED_TRACE(name);
    const std::vector<float> input = random_floats(p.m * p.k, kBf16Seed),
                             bias = random_floats(p.n, kBf16Seed + 2);
    std::vector<float> weights = random_floats(p.n * p.k, kBf16Seed + 1);
    std::vector<BFloat16> narrow(weights.size());
    for (size_t i = 0; i < weights.size(); ++i) {
      narrow[i] = to_bfloat16(weights[i]);
      weights[i] = to_float(narrow[i]);
    }
    test::for_each_simd_target([&, p = p] {
      std::vector<float> found(static_cast<size_t>(p.m * p.n), NAN), wanted = found;
      kInnerProductGemv.run(p, input.data(), weights.data(), bias.data(), wanted.data());
      inner_product_bf16(p, input.data(), narrow.data(), bias.data(), found.data());
      EXPECT_EQ(found, wanted);
    });
  }
}

Net mixed_net() {
  return test::small_net(
      {2, 3, 31, 29},
      test::conv("a", "data", "num_output: 32 kernel_size: 3 stride: 2") +
          test::in_place("r", "ReLU", "a") + test::conv("b", "a", "num_output: 48 kernel_size: 1") +
          test::conv("c", "a", "num_output: 24 kernel_size: 3 pad: 1") +
          test::layer("j", "Concat", {"b", "c"}, "") +
          test::conv("d", "j", "num_output: 72 kernel_size: 1") +
          test::layer("s", "Eltwise", {"d", "j"}, "") +
          test::conv("w", "s", "num_output: 72 kernel_size: 3 group: 72 stride: 2") +
          test::layer("p", "Pooling", {"w"}, "pooling_param { kernel_size: 2 stride: 2 }") +
          test::layer("i", "InnerProduct", {"p"}, "inner_product_param { num_output: 10 }"),
      {}, test::Weights::kRandom);
}

std::vector<float> output_of(const Net& net, const PlanOptions& options) {
  Run run(net.plan({}, options));
  const View<float> input = run.input("data");
  const std::vector<float> values = random_floats(input.shape.elements(), kBf16Seed);
  std::copy(values.begin(), values.end(), input.data);
  run.forward();
  const View<const float> output = run.output("i");
  return {output.data, output.data + output.shape.elements()};
}

TEST(Bf16Nets, AreCloseToFloat32AndTheSameForAnyNumberOfThreads) {
  const Net net = mixed_net();
  const std::vector<float> wanted = output_of(net, {});
  const std::vector<float> found = output_of(net, {.precision = Precision::kBf16});
  const double error = relative_error(found, wanted);
  EXPECT_GT(error, 1e-5);  // bfloat16 was used
  EXPECT_LT(error, 2e-2);
  for (const int threads : {2, 3})
    EXPECT_EQ(output_of(net, {.threads = threads, .precision = Precision::kBf16}), found);
  const std::vector<float> weights_only = output_of(net, {.bf16_weights = true});
  EXPECT_NE(weights_only, wanted);
  EXPECT_LT(relative_error(weights_only, wanted), error + 1e-2);
  EXPECT_LT(
      relative_error(output_of(net, {.keep_all = true, .precision = Precision::kBf16}), wanted),
      2e-2);
  EXPECT_EQ(output_of(net, {.reference_kernels = true, .precision = Precision::kBf16}),
            output_of(net, {.reference_kernels = true}));
}

/// A pooling strip with only the last, empty window, and strides larger than the kernels: rows in
/// no window must not be computed.
TEST(Bf16Nets, PoolWindowsThatAreEmptyBehindTheFirstConvolution) {
  REVISIT_NEED_BLOCKED_KERNELS();
  const Net net = test::small_net(
      {1, 3, 140, 140},
      test::conv("c", "data", "num_output: 512 kernel_size: 2 stride: 4") +
          test::layer("i", "Pooling", {"c"}, "pooling_param { kernel_size: 1 stride: 33 }"));
  EXPECT_EQ(test::kernel_of(net.plan({}, {.precision = Precision::kBf16}), "i"), "in c");
  EXPECT_EQ(output_of(net, {.precision = Precision::kBf16}),
            output_of(net, {.keep = {"c"}, .precision = Precision::kBf16}));
}

TEST(Bf16Nets, EmptyMaximaAreNumbers) {
  for (const std::string top : {"", "top: 'mask' "})
    for (const std::string& first : {test::conv("c", "data", "num_output: 32 kernel_size: 1"),
                                     test::layer("c", "Power", {"data"})}) {
      const Net net = test::small_net(
          {1, 16, 4, 64}, first + "layer { name: 'p' type: 'Pooling' bottom: 'c' top: 'p' " + top +
                              "pooling_param { kernel_size: 1 stride: 2 } } " +
                              test::in_place("r", "ReLU", "p") +
                              test::conv("i", "p", "num_output: 16 kernel_size: 1"));
      EXPECT_LT(relative_error(output_of(net, {.precision = Precision::kBf16}), output_of(net, {})),
                2e-2)
          << top << first;
    }
  for (const float value : {-FLT_MAX, empty_maximum(Precision::kBf16)})
    EXPECT_EQ(std::isfinite(to_float(to_bfloat16(value))), value != -FLT_MAX);
}

TEST(Bf16Nets, TakeLessMemoryAndKeepToTheLimit) {
  REVISIT_NEED_BLOCKED_KERNELS();
  const Net net = mixed_net();
  const Plan wide = net.plan(), narrow = net.plan({}, {.precision = Precision::kBf16});
  EXPECT_LT(narrow.arena_bytes(), wide.arena_bytes());
  const auto kernel_of = [](const Plan& plan, const std::string& name) {
    for (const LayerCost& layer : plan.layers())
      if (layer.name == name) return layer.kernel;
    return std::string();
  };
  EXPECT_EQ(kernel_of(narrow, "b"), has_bf16_tiles() ? "tiles bf16" : "pointwise bf16");
  EXPECT_EQ(kernel_of(narrow, "i"), "gemv bf16");
  const PlanOptions tight{.max_run_bytes = narrow.arena_bytes() + narrow.packed_weight_bytes() - 1,
                          .precision = Precision::kBf16};
  // Without packed weights a convolution needs scratch, which may exceed what tiles take.
  try {
    const Plan limited = net.plan({}, tight);
    EXPECT_LE(limited.arena_bytes() + limited.packed_weight_bytes(), tight.max_run_bytes);
  } catch (const InputError& error) {
    EXPECT_TRUE(has_bf16_tiles()) << error.what();
    EXPECT_HAS(std::string(error.what()), "more than the limit");
  }
}

}  // namespace
}  // namespace revisit::engine
