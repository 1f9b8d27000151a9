// Outputs are poisoned with NaN.
#include "problems.h"
#include "simd_targets.h"
#include "single_layer.h"
#include "testing.h"

namespace revisit::engine {
namespace {

class InnerProductKernels : public testing::TestWithParam<test::Named<InnerProductProblem>> {};

TEST_P(InnerProductKernels, AgreeWithTheDefinition) {
  constexpr unsigned kSeed = 20260723;
  SCOPED_TRACE(testing::Message() << "seed " << kSeed);
  InnerProductProblem p = GetParam().problem;
  const auto input = test::random_floats(p.m * p.k, kSeed);
  const auto weights = test::random_floats(p.n * p.k, kSeed + 1);
  const auto bias = test::random_floats(p.n, kSeed + 2);
  const auto run = [&](const InnerProductKernel& kernel, const float* b) {
    std::vector<float> output(static_cast<size_t>(p.m * p.n), NAN);
    kernel.run(p, input.data(), weights.data(), b, output.data());
    return output;
  };
  for (const float* b : {bias.data(), static_cast<const float*>(nullptr)}) {
    const std::vector<float> wanted = run(kInnerProductReference, b);
    for (const InnerProductKernel* kernel : {&kInnerProductGemv, &kInnerProductGemm}) {
      if (kernel == &kInnerProductGemv && !p.has_few_inputs()) continue;
      SCOPED_TRACE(kernel->name);
      test::for_each_simd_target([&] {
        p.threads = 1;
        const std::vector<float> found = run(*kernel, b);
        EXPECT_LE(relative_error(found, wanted), 2e-6);
        for (p.threads = 2; p.threads <= 3; ++p.threads) EXPECT_EQ(run(*kernel, b), found);
      });
    }
  }
}

INSTANTIATE_TEST_SUITE_P(Problems, InnerProductKernels,
                         testing::ValuesIn(test::inner_product_problems()),
                         [](const auto& instance) { return test::test_name(instance.param); });

TEST(InnerProductReference, ByHand) {
  const float input[] = {1, 2, 3}, weights[] = {1, 10, 100, 2, 0, 1}, bias[] = {0.5F, -1};
  float output[2];
  kInnerProductReference.run({1, 2, 3}, input, weights, bias, output);
  EXPECT_EQ(output[0], 321.5F);
  EXPECT_EQ(output[1], 4);
  const float transposed[] = {1, 2, 10, 0, 100, 1};
  kInnerProductReference.run({1, 2, 3, true}, input, transposed, nullptr, output);
  EXPECT_EQ(output[0], 321);
  EXPECT_EQ(output[1], 5);
}

}  // namespace
}  // namespace revisit::engine
