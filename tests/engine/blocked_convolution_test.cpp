// Problems: tests/problems/convolution.txt. Outputs and packed weights are poisoned with NaN,
// scratch with 0xA5 bytes.
#include "blocked.h"
#include "kernels/blocked/kernels.h"
#include "kernels/blocked/partition.h"
#include "problems.h"
#include "simd_targets.h"
#include "single_layer.h"
#include "testing.h"

namespace revisit::engine {
namespace {

constexpr unsigned kConvolutionSeed = 20260722;

/// Arrays in Caffe's layouts.
struct BlockedCase {
  ConvolutionProblem p;
  std::vector<float> input, weights, bias, addend;  // addend may be empty
  Epilogue epilogue;

  explicit BlockedCase(const ConvolutionProblem& problem)
      : p(problem),
        input(random_floats(p.n * p.c_in * p.h * p.w, kConvolutionSeed)),
        weights(random_floats(p.c_out * p.depth(), kConvolutionSeed + 1)),
        bias(random_floats(p.c_out, kConvolutionSeed + 2)) {}

  int64_t outputs() const { return p.n * p.c_out * p.out_pixels(); }
};

std::vector<float> definition_of(const BlockedCase& c) {
  std::vector<float> output(static_cast<size_t>(c.outputs()));
  const ConvolutionNdProblem p = test::over_axes(c.p);
  std::vector<float> scratch(static_cast<size_t>(kConvolutionReference.scratch_floats(p)));
  kConvolutionReference.run(p, c.input.data(), c.weights.data(), c.bias.data(), output.data(),
                            scratch.data());
  return output;
}

test::AlignedFloats per_channel(int64_t channels, std::span<const float> values) {
  return test::to_blocked(1, channels, 1, values);
}

test::AlignedFloats pack(const BlockedConvolutionKernel& kernel, const BlockedCase& c) {
  test::AlignedFloats packed(kernel.packed_floats(c.p), test::kNanByte);
  kernel.pack(c.p, c.weights.data(), packed.data());
  return packed;
}

test::AlignedFloats run_kernel(const BlockedConvolutionKernel& kernel, const BlockedCase& c,
                               const test::AlignedFloats& packed, int threads = 1) {
  ConvolutionProblem p = c.p;
  p.threads = threads;
  const auto blocked_input = test::to_blocked(p.n, p.c_in, p.h * p.w, c.input);
  const auto bias = per_channel(p.c_out, c.bias);
  const auto addend =
      test::to_blocked(p.n, p.c_out, c.addend.empty() ? 0 : p.out_pixels(), c.addend);
  test::AlignedFloats scratch(kernel.scratch_floats(p), test::kDirtyByte);
  test::AlignedFloats output(p.n * padded_channels(p.c_out) * p.out_pixels(), test::kNanByte);
  kernel.run(p, {kernel.input == Layout::kNchw ? c.input.data() : blocked_input.data(),
                 packed.data(), bias.data(), c.addend.empty() ? nullptr : addend.data(), c.epilogue,
                 output.data(), scratch.data()});
  return output;
}

std::vector<float> plain(const BlockedCase& c, const test::AlignedFloats& output) {
  return test::to_plain(c.p.n, c.p.c_out, c.p.out_pixels(), output.values());
}

bool is_winograd(const BlockedConvolutionKernel& kernel) {
  return std::string_view(kernel.name).starts_with("winograd");
}

/// Tolerance relative to the largest output: for another order of summation, and for Winograd's
/// transforms, which amplify rounding more with more points per tile.
double tolerance(const BlockedConvolutionKernel& kernel) {
  const std::string_view name = kernel.name;
  if (!is_winograd(kernel)) return 5e-6;
  return name.starts_with("winograd F(4x") ? 2e-5 : 5e-5;
}

/// Limits the time on emulated instructions.
bool is_small(const ConvolutionProblem& p) {
  return p.macs() < 8'000'000;
}

class BlockedConvolution : public testing::TestWithParam<test::NamedConvolution> {};

TEST_P(BlockedConvolution, AgreesWithTheDefinition) {
  SCOPED_TRACE(testing::Message() << "seed " << kConvolutionSeed);
  const BlockedCase c(GetParam().problem);
  const std::vector<float> wanted = definition_of(c);
  for (const BlockedConvolutionKernel& kernel : blocked_convolution_kernels()) {
    if (!kernel.supports(c.p)) continue;
    SCOPED_TRACE(kernel.name);
    const test::AlignedFloats packed = pack(kernel, c);
    const auto check = [&] {
      test::AlignedFloats output = run_kernel(kernel, c, packed);
      EXPECT_LE(relative_error(plain(c, output), wanted), tolerance(kernel));
      EXPECT_EQ(test::find_dirty_tail(c.p.n, c.p.c_out, c.p.out_pixels(), output.values()), -1);
      return output;
    };
    const test::AlignedFloats output = check();
    if (is_small(c.p)) test::for_each_blocked_case(check);
    for (const int threads : {2, 3}) {
      const test::AlignedFloats more = run_kernel(kernel, c, packed, threads);
      EXPECT_EQ(std::memcmp(output.data(), more.data(), output.values().size_bytes()), 0)
          << threads << " threads";
    }
  }
}

INSTANTIATE_TEST_SUITE_P(Problems, BlockedConvolution,
                         testing::ValuesIn(test::convolution_problems()),
                         [](const auto& instance) { return test::test_name(instance.param); });

/// One small problem with tails for each kernel.
std::vector<ConvolutionProblem> small_problems() {
  std::vector<ConvolutionProblem> problems;
  for (const auto& named : test::convolution_problems())
    for (const char* name :
         {"odd-tails", "odd-tails-5x5", "odd-wide-group-pointwise", "odd-depthwise-5x5",
          "odd-narrow-groups-4", "odd-narrow-groups-8", "odd-plain-stride-3"})
      if (named.name == name) problems.push_back(named.problem);
  return problems;
}

template <class Check>
void for_each_kernel(const Check& check) {
  for (const ConvolutionProblem& p : small_problems())
    test::for_each_blocked_case([&] {
      for (const BlockedConvolutionKernel& kernel : blocked_convolution_kernels()) {
        SCOPED_TRACE(kernel.name);
        if (kernel.supports(p)) check(kernel, p);
      }
    });
}

TEST(BlockedConvolutionSmall, EveryKernelIsThere) {
  for (const BlockedConvolutionKernel& kernel : blocked_convolution_kernels()) {
    auto problems = small_problems();
    if (kernel.products == Products::kTiles)  // tested by Bf16Convolution
      for (ConvolutionProblem& p : problems) p.values = Precision::kBf16;
    EXPECT_TRUE(std::any_of(problems.begin(), problems.end(), kernel.supports)) << kernel.name;
  }
}

float activated(const Epilogue& e, int64_t channel, float x) {
  using Activation = Epilogue::Activation;
  switch (e.activation) {
    case Activation::kNone:
      return x;
    case Activation::kRelu:
      return x < 0 ? e.slope * x : x;
    case Activation::kPrelu:
      return x < 0 ? e.slopes[channel] * x : x;
    case Activation::kElu:
      return x < 0 ? e.slope * std::expm1(x) : x;
    case Activation::kClip:
      return x < e.low ? e.low : x > e.high ? e.high : x;
    case Activation::kSigmoid:
      return 1 / (1 + std::exp(-x));
    case Activation::kSwish:
      return x / (1 + std::exp(-e.slope * x));
    case Activation::kTanh:
      return std::tanh(x);
    case Activation::kBnll:
      return std::log1p(std::exp(x));
    case Activation::kMish:
      return x * std::tanh(std::log1p(std::exp(x)));
  }
  return x;
}

TEST(BlockedConvolutionSmall, EpiloguesAndAddend) {
  using Activation = Epilogue::Activation;
  for_each_kernel([](const BlockedConvolutionKernel& kernel, const ConvolutionProblem& p) {
    const auto slopes = per_channel(p.c_out, random_floats(p.c_out, kConvolutionSeed + 3));
    BlockedCase c(p);
    const std::vector<float> sums = definition_of(c);
    for (const Epilogue& epilogue :
         {Epilogue{}, Epilogue{.activation = Activation::kRelu},
          Epilogue{.activation = Activation::kRelu, .slope = 0.1F},
          Epilogue{.activation = Activation::kPrelu, .slopes = slopes.data()},
          Epilogue{.activation = Activation::kElu, .slope = 0.7F},
          // No value is zero, but padding lanes must be.
          Epilogue{.activation = Activation::kClip, .low = 0.5F, .high = 2}})
      for (const bool with_addend : {false, true}) {
        c.epilogue = epilogue;
        c.addend =
            with_addend ? random_floats(c.outputs(), kConvolutionSeed + 4) : std::vector<float>();
        std::vector<float> wanted = sums;
        for (size_t i = 0; i < wanted.size(); ++i) {
          const int64_t channel = static_cast<int64_t>(i) / p.out_pixels() % p.c_out;
          wanted[i] = activated(epilogue, channel, wanted[i] + (with_addend ? c.addend[i] : 0.0F));
        }
        const test::AlignedFloats output = run_kernel(kernel, c, pack(kernel, c));
        EXPECT_LE(relative_error(plain(c, output), wanted), 2 * tolerance(kernel))
            << "activation " << static_cast<int>(epilogue.activation)
            << (with_addend ? " with addend" : "");
        EXPECT_EQ(test::find_dirty_tail(p.n, p.c_out, p.out_pixels(), output.values()), -1);
      }
  });
}

/// Compares with the kernel's own sums, whose errors are checked above.
TEST(BlockedConvolutionSmall, SmoothActivations) {
  using Activation = Epilogue::Activation;
  for_each_kernel([](const BlockedConvolutionKernel& kernel, const ConvolutionProblem& p) {
    BlockedCase c(p);
    const test::AlignedFloats packed = pack(kernel, c);
    const std::vector<float> sums = plain(c, run_kernel(kernel, c, packed));
    for (const Epilogue& epilogue :
         {Epilogue{.activation = Activation::kSigmoid},
          Epilogue{.activation = Activation::kSwish, .slope = 0.7F},
          Epilogue{.activation = Activation::kTanh}, Epilogue{.activation = Activation::kBnll},
          Epilogue{.activation = Activation::kMish}}) {
      c.epilogue = epilogue;
      std::vector<float> wanted = sums;
      for (float& x : wanted) x = activated(epilogue, 0, x);
      const test::AlignedFloats output = run_kernel(kernel, c, packed);
      EXPECT_LE(relative_error(plain(c, output), wanted), 1e-6)
          << "activation " << static_cast<int>(epilogue.activation);
      EXPECT_EQ(test::find_dirty_tail(p.n, p.c_out, p.out_pixels(), output.values()), -1);
    }
  });
}

/// NaN sums stay NaN under every activation, as in Caffe, and do not reach padding lanes.
TEST(BlockedConvolutionSmall, NanStaysNan) {
  using Activation = Epilogue::Activation;
  for_each_kernel([](const BlockedConvolutionKernel& kernel, const ConvolutionProblem& p) {
    const auto slopes = per_channel(p.c_out, random_floats(p.c_out, kConvolutionSeed + 3));
    BlockedCase c(p);
    const int64_t bad = p.c_out - 1;
    c.bias[static_cast<size_t>(bad)] = std::numeric_limits<float>::quiet_NaN();
    for (const Epilogue& epilogue :
         {Epilogue{}, Epilogue{.activation = Activation::kRelu},
          Epilogue{.activation = Activation::kPrelu, .slopes = slopes.data()},
          Epilogue{.activation = Activation::kElu, .slope = 1},
          Epilogue{.activation = Activation::kSigmoid},
          Epilogue{.activation = Activation::kSwish, .slope = 1},
          Epilogue{.activation = Activation::kTanh}, Epilogue{.activation = Activation::kBnll},
          Epilogue{.activation = Activation::kMish},
          Epilogue{.activation = Activation::kClip, .low = -1, .high = 1}}) {
      c.epilogue = epilogue;
      const test::AlignedFloats output = run_kernel(kernel, c, pack(kernel, c));
      const std::vector<float> found = plain(c, output);
      for (size_t i = 0; i < found.size(); ++i)
        ASSERT_EQ(std::isnan(found[i]), static_cast<int64_t>(i) / p.out_pixels() % p.c_out == bad)
            << "output " << i << ", activation " << static_cast<int>(epilogue.activation);
      EXPECT_EQ(test::find_dirty_tail(p.n, p.c_out, p.out_pixels(), output.values()), -1);
    }
  });
}

/// Infinite and NaN inputs yield the definition's results; 0 * infinity must not reach padding
/// lanes. Winograd's transforms spread them over a tile.
TEST(BlockedConvolutionSmall, InputsThatAreNotFinite) {
  for_each_kernel([](const BlockedConvolutionKernel& kernel, const ConvolutionProblem& p) {
    BlockedCase c(p);
    c.input[c.input.size() / 2] = std::numeric_limits<float>::infinity();
    c.input[c.input.size() / 3] = std::numeric_limits<float>::quiet_NaN();
    const std::vector<float> wanted = definition_of(c);
    const test::AlignedFloats output = run_kernel(kernel, c, pack(kernel, c));
    const std::vector<float> found = plain(c, output);
    for (size_t i = 0; i < found.size(); ++i)
      if (!is_winograd(kernel) || !std::isfinite(wanted[i])) {
        ASSERT_EQ(std::isfinite(found[i]), std::isfinite(wanted[i])) << "output " << i;
      }
    EXPECT_EQ(test::find_dirty_tail(p.n, p.c_out, p.out_pixels(), output.values()), -1);
  });
}

TEST(ChooseBlockedConvolution, TakesTheFastestThatTakesTheLayout) {
  for (const auto& [name, p] : test::convolution_problems())
    for (const Layout layout : {Layout::kNchw, Layout::kNChw16c}) {
      const BlockedConvolutionKernel* chosen = choose_blocked_convolution(p, layout);
      for (const BlockedConvolutionKernel& kernel : blocked_convolution_kernels()) {
        if (kernel.input != layout || !kernel.supports(p)) continue;
        ASSERT_NE(chosen, nullptr) << name;
        EXPECT_LE(chosen->predicted_ms(p), kernel.predicted_ms(p)) << name << ", " << kernel.name;
      }
      if (!chosen) continue;
      EXPECT_EQ(chosen->input, layout) << name;
      EXPECT_TRUE(chosen->supports(p)) << name;
    }
}

TEST(Chunks, AllHaveColumns) {
  for (const Panel panel : {kRegisterPanel, kTilePanel})
    for (int64_t products = 1; products < 20; ++products)
      for (const int64_t columns : {1, 2, 3, 13, 15, 29, 64, 1000})
        for (int threads = 1; threads < 20; ++threads) {
          const Split cut = cut_into_chunks(products, columns, 8, threads, panel).columns;
          EXPECT_LE(cut.parts, cut.units())
              << products << " products of " << columns << " columns, threads: " << threads;
        }
}

/// The planner falls back to im2col where groups begin and end within blocks.
TEST(ChooseBlockedConvolution, NothingForGroupsAcrossBlocks) {
  ConvolutionProblem p;
  p.c_in = p.c_out = 120, p.group = 6;
  p.h = p.w = p.out_h = p.out_w = 14, p.kernel_h = p.kernel_w = 3, p.pad_h = p.pad_w = 1;
  EXPECT_EQ(choose_blocked_convolution(p, Layout::kNChw16c), nullptr);
  EXPECT_EQ(choose_blocked_convolution(p, Layout::kNchw), nullptr);
}

/// New widths re-plan without packing again.
TEST(BlockedConvolutionSmall, PackingDependsOnTheWeightsOnly) {
  for (const ConvolutionProblem& p : small_problems())
    for (const BlockedConvolutionKernel& kernel : blocked_convolution_kernels()) {
      if (!kernel.supports(p)) continue;
      ConvolutionProblem other = p;
      other.n = 3, other.h += 5, other.w += 7, other.out_h += 5, other.out_w += 7,
      other.threads = 2;
      const test::AlignedFloats a = pack(kernel, BlockedCase(p)),
                                b = pack(kernel, BlockedCase(other));
      ASSERT_EQ(a.values().size(), b.values().size()) << kernel.name;
      EXPECT_EQ(std::memcmp(a.data(), b.data(), a.values().size_bytes()), 0) << kernel.name;
    }
}

}  // namespace
}  // namespace revisit::engine
