#include "kernels/blocked/kernels.h"
#include "net_case.h"
#include "testing.h"

namespace revisit::engine {
namespace {

const LayerCost& traffic_of(const Plan& plan, const std::string& name) {
  for (const LayerCost& layer : plan.layers())
    if (layer.name == name) return layer;
  throw std::runtime_error("no layer " + name);
}

TEST(LayerTraffic, CountsReadsAndWritesOfKernels) {
  // NCHW values; conv and relu are one kernel, Dropout moves nothing.
  const Net net = test::small_net(
      {1, 2, 6, 8},
      test::conv("conv", "data", "num_output: 3 kernel_size: 1") +
          test::in_place("relu", "ReLU", "conv") + test::in_place("drop", "Dropout", "conv") +
          "layer { name: 'pool' type: 'Pooling' bottom: 'conv' top: 'pool' pooling_param { "
          "kernel_size: 2 stride: 2 } }\n"
          "layer { name: 'ip' type: 'InnerProduct' bottom: 'pool' top: 'ip' inner_product_param { "
          "num_output: 5 } }\n",
      {}, test::Weights::kNone);
  const Plan plan = net.plan({}, {.reference_kernels = true});
  constexpr int64_t kFloat = 4;
  const auto expect = [&](const std::string& layer, int64_t read, int64_t written) {
    EXPECT_EQ(traffic_of(plan, layer).read_bytes, kFloat * read) << layer;
    EXPECT_EQ(traffic_of(plan, layer).written_bytes, kFloat * written) << layer;
  };
  expect("data", 0, 0);
  expect("conv", 2 * 6 * 8 + 3 * 2 + 3, 3 * 6 * 8);
  expect("drop", 0, 0);
  expect("pool", 3 * 6 * 8, 3 * 3 * 4);
  expect("ip", 3 * 3 * 4 + 5 * 36 + 5, 5);
  EXPECT_EQ(traffic_of(plan, "conv").multiplications, traffic_of(plan, "conv").macs);
  EXPECT_EQ(traffic_of(plan, "ip").multiplications, 5 * 36);
  EXPECT_EQ(traffic_of(plan, "pool").multiplications, 0);
}

TEST(LayerTraffic, EmbedReadsAFewRowsOfItsWeights) {
  const Net net = test::small_net(
      {3},
      "layer { name: 'embed' type: 'Embed' bottom: 'data' top: 'embed' embed_param { input_dim: "
      "1000 num_output: 7 bias_term: false } }\n",
      {}, test::Weights::kNone);
  const Plan plan = net.plan();
  EXPECT_EQ(traffic_of(plan, "embed").read_bytes, 4 * (3 + 3 * 7));
}

TEST(Multiplications, WinogradNeedsFewerAndSaysHowMany) {
  // F(4x4,3x3) multiplies 6 x 6 numbers for 4 x 4 outputs of 9 products each.
  ConvolutionProblem p{1, 32, 24, 48, 64, 24, 48, 3, 3, 1, 1, 1, 1};
  for (const BlockedConvolutionKernel& kernel : blocked_convolution_kernels()) {
    if (!kernel.multiplications) continue;
    EXPECT_GT(kernel.transform_points, 0) << kernel.name;
    EXPECT_LT(kernel.multiplications(p), p.macs()) << kernel.name;
    if (std::strcmp(kernel.name, "winograd F(4x4,3x3)") == 0) {
      EXPECT_EQ(kernel.multiplications(p), p.macs() * 36 / (16 * 9));
    }
  }
  // Tiles at the border are complete.
  p.out_w = p.w = 45;
  for (const BlockedConvolutionKernel& kernel : blocked_convolution_kernels())
    if (std::strcmp(kernel.name, "winograd F(4x4,3x3)") == 0) {
      EXPECT_EQ(kernel.multiplications(p), 6 * 12 * 36 * 32 * 64);
    }
}

}  // namespace
}  // namespace revisit::engine
