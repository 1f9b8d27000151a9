// Outputs are poisoned with NaN and scratch with 0xA5 bytes before each run.
#include "problems.h"
#include "single_layer.h"
#include "testing.h"

namespace revisit::engine {
namespace {

std::vector<float> run(const ConvolutionNdKernel& kernel, const ConvolutionNdProblem& p,
                       const std::vector<float>& input, const std::vector<float>& weights,
                       const float* bias) {
  std::vector<float> output(static_cast<size_t>(p.n * p.c_windows * p.windows()),
                            std::numeric_limits<float>::quiet_NaN());
  std::vector<float> scratch(static_cast<size_t>(kernel.scratch_floats(p)));
  if (!scratch.empty()) std::memset(scratch.data(), 0xA5, scratch.size() * sizeof(float));
  kernel.run(p, input.data(), weights.data(), bias, output.data(), scratch.data());
  return output;
}

class ConvolutionKernels : public testing::TestWithParam<test::NamedConvolution> {};

TEST_P(ConvolutionKernels, AgreeWithTheDefinition) {
  constexpr unsigned kSeed = 20260611;
  SCOPED_TRACE(testing::Message() << "seed " << kSeed);
  ConvolutionNdProblem p = test::over_axes(GetParam().problem);
  const auto input = random_floats(p.n * p.c_image * p.image_pixels(), kSeed);
  const auto weights = random_floats(p.c_windows * p.depth(), kSeed + 1);
  const auto bias = random_floats(p.c_windows, kSeed + 2);
  for (const float* b : {bias.data(), static_cast<const float*>(nullptr)}) {
    const auto wanted = run(kConvolutionReference, p, input, weights, b);
    for (const ConvolutionNdKernel& kernel : convolution_kernels()) {
      if (!kernel.supports(p)) continue;
      for (const int threads : {1, 2}) {
        p.threads = threads;
        EXPECT_LE(relative_error(run(kernel, p, input, weights, b), wanted), 5e-6)
            << kernel.name << ", " << threads << " threads";
      }
    }
  }
}

INSTANTIATE_TEST_SUITE_P(Problems, ConvolutionKernels,
                         testing::ValuesIn(test::convolution_problems()),
                         [](const auto& instance) { return test::test_name(instance.param); });

TEST(ConvolutionReference, ByHand) {
  // 1 x 1 x 2 x 3 input, 2 x 2 kernel, stride 1, pad 0: a cross-correlation, no flip.
  ConvolutionProblem p;
  p.h = 2, p.w = 3, p.kernel_h = 2, p.kernel_w = 2, p.out_h = 1, p.out_w = 2;
  const float input[] = {1, 2, 3, 4, 5, 6}, weights[] = {1, 10, 100, 1000}, bias[] = {0.5F};
  float output[2], scratch[4];
  kConvolutionReference.run(test::over_axes(p), input, weights, bias, output, scratch);
  EXPECT_EQ(output[0], 1 + 20 + 400 + 5000 + 0.5F);
  EXPECT_EQ(output[1], 2 + 30 + 500 + 6000 + 0.5F);
}

}  // namespace
}  // namespace revisit::engine
