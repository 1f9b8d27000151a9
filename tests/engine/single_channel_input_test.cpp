#include "net_case.h"
#include "simd_targets.h"
#include "testing.h"

namespace revisit::engine {
namespace {

std::vector<float> run(const Plan& plan) {
  engine::Run run(plan);
  const View<float> input = run.input("data");
  const int64_t channels = input.shape[1], pixels = input.shape[2] * input.shape[3];
  static const std::vector<float> kOffsets{0.5F, -2, 3};
  for (int64_t n = 0; n < input.shape[0]; ++n)
    for (int64_t c = 0; c < channels; ++c)
      for (int64_t i = 0; i < pixels; ++i)
        input.data[(n * channels + c) * pixels + i] =
            static_cast<float>((i * 7919 + n) % 255) / 50 + (channels == 3 ? kOffsets[c] : 0);
  run.forward();
  const auto values = run.output(run.plan().outputs()[0].name).values();
  return {values.begin(), values.end()};
}

std::vector<float> run(const Net& net, const PlanOptions& options) {
  return run(net.plan({}, options));
}

struct GrayCase {
  const char *name, *convolution;
};

class GrayInput : public testing::TestWithParam<GrayCase> {};

TEST_P(GrayInput, EqualsThreeEqualChannels) {
  test::for_each_simd_target([] {
    for (const int64_t n : {1, 2}) {
      const Net net =
          small_net({n, 3, 13, 17},
                    std::string("layer { name: 'c' type: 'Convolution' bottom: 'data' top: 'c' "
                                "convolution_param { ") +
                        GetParam().convolution +
                        " } } layer { name: 'a' type: 'ReLU' bottom: 'c' top: 'c' }");
      const std::vector<float> wanted = run(net, {.reference_kernels = true});
      const std::vector<float> offsets{0.5F, -2, 3};
      for (const bool reference : {false, true}) {
        PlanOptions options{.reference_kernels = reference, .channel_offsets = offsets};
        EXPECT_EQ(net.plan({}, options).inputs()[0].shape, (Shape{n, 1, 13, 17}));
        EXPECT_LE(relative_error(run(net, options), wanted), 1e-5);
        options.keep_all = true;
        EXPECT_LE(relative_error(run(net, options), wanted), 1e-5);
      }
    }
  });
}

TEST(GrayInputOptions, ExactWithScaleAndPoolingBehind) {
  REVISIT_NEED_BLOCKED_KERNELS();
  const Net net = small_net(
      {1, 3, 23, 31},
      test::conv("c", "data", "num_output: 32 kernel_size: 5 stride: 2 pad: 2") +
          test::in_place("b", "BatchNorm", "c") + test::in_place("s", "Scale", "c") +
          test::in_place("a", "ReLU", "c") +
          test::layer("p", "Pooling", {"c"}, "pooling_param { kernel_size: 3 stride: 2 }"));
  EXPECT_TRUE(net.takes_single_channel_input());
  const PlanOptions gray{.channel_offsets = std::vector<float>{0.5F, -2, 3}};
  const Plan plan = net.plan({}, gray);
  for (const char* name : {"b", "s", "a", "p"}) EXPECT_EQ(test::kernel_of(plan, name), "in c");
  EXPECT_EQ(plan.layers()[1].macs, net.plan().layers()[1].macs) << "those of the file";
  EXPECT_LE(relative_error(run(net, gray), run(net, {.reference_kernels = true})), 1e-5);
}

INSTANTIATE_TEST_SUITE_P(
    Convolutions, GrayInput,
    testing::Values(GrayCase{"NoPadding", "num_output: 32 kernel_size: 3 stride: 2"},
                    GrayCase{"Padding", "num_output: 32 kernel_size: 7 stride: 2 pad: 1"},
                    GrayCase{"MuchPadding", "num_output: 16 kernel_size: 5 pad: 4"},
                    GrayCase{"PaddingWiderThanTheStride",
                             "num_output: 16 kernel_h: 1 kernel_w: 6 "
                             "stride_h: 1 stride_w: 3 pad_h: 0 pad_w: 5"},
                    GrayCase{"PaddedRowsOnly", "num_output: 32 kernel_size: 5 pad_h: 2 pad_w: 0"},
                    GrayCase{"LargerThanTheImage", "num_output: 16 kernel_size: 19 pad: 6"},
                    GrayCase{"LargerThanTheImageWithoutPadding",
                             "num_output: 16 kernel_h: 15 kernel_w: 3 stride: 4"},
                    GrayCase{"Dilation", "num_output: 16 kernel_size: 3 pad: 2 dilation: 3"},
                    GrayCase{"NoBias", "num_output: 32 kernel_size: 3 pad: 1 bias_term: false"},
                    GrayCase{"FewOutputs", "num_output: 3 kernel_size: 3 pad: 1"}),
    [](const auto& instance) { return std::string(instance.param.name); });

/// Whether a kernel without padding reads beyond the image, and so its packed weights, depends on
/// the size of the image. Two plans of one net may differ in it.
TEST(GrayInputOptions, TwoHeightsOfOneNetAlive) {
  const Shape low{1, 3, 13, 17}, high{1, 3, 40, 17};
  for (const char* c_out : {"16", "3"}) {  // NCHWc and NCHW
    const std::string layer =
        test::conv("c", "data", str("num_output: ", c_out, " kernel_h: 15 kernel_w: 3 stride: 4"));
    for (const auto& [first, second] : {std::pair(low, high), std::pair(high, low)}) {
      const Net net = small_net(first, layer);
      const PlanOptions gray{.channel_offsets = std::vector<float>{0.5F, -2, 3}};
      const Plan one = net.plan({}, gray), other = net.plan({{"data", second}}, gray);
      for (const Plan& plan : {one, other}) {
        const Shape picture = plan.inputs()[0].shape;
        const Plan reference =
            net.plan({{"data", picture.with(1, 3)}}, {.reference_kernels = true});
        EXPECT_LE(relative_error(run(plan), run(reference)), 1e-5)
            << c_out << " channels, " << picture << " after " << first;
      }
    }
  }
}

TEST(GrayInputOptions, OnlyWhereConvolutionsReadTheInput) {
  const auto plan = [](const std::string& layers, std::vector<float> offsets) {
    small_net({1, 3, 8, 8}, layers).plan({}, {.channel_offsets = std::move(offsets)});
  };
  const std::string conv =
      "layer { name: 'c' type: 'Convolution' bottom: 'data' top: 'c' convolution_param { "
      "num_output: 3 kernel_size: 1 ";
  expect_error<UsageError>(
      [&] {
        plan(conv + "} }", {0, 0});
      },
      {"each of the 3 channels", "found 2"});
  expect_error<UsageError>(
      [&] {
        plan(conv + "group: 3 } }", {0, 0, 0});
      },
      {"'c' (Convolution)", "without groups"});
  expect_error<UsageError>(
      [&] {
        plan(conv +
                 "} } layer { name: 'p' type: 'Pooling' bottom: 'data' top: 'p' "
                 "pooling_param { kernel_size: 2 } }",
             {0, 0, 0});
      },
      {"'p' (Pooling)", "reads the input"});
}

}  // namespace
}  // namespace revisit::engine
