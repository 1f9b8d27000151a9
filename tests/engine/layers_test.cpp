#include "checked_layer.h"
#include "testing.h"

namespace revisit::engine {
namespace {

TEST(ReLU, KeepsCaffesSpecialCases) {
  expect_near(run("ReLU", "", {6}, {-2, 0, 3, kInf, -kInf, kNan}), {0, 0, 3, kInf, kNan, kNan});
  expect_near(run("ReLU", "relu_param { negative_slope: 0.5 }", {3}, {-2, 0, 3}), {-1, 0, 3});
}

TEST(Pooling, RoundsUpAndClipsTheLastWindow) {
  // 1x4, kernel 3, stride 2: ceil((4 - 3) / 2) + 1 = 2 windows, the second clipped to one column
  // pair.
  const std::string max =
      "pooling_param { pool: MAX kernel_h: 1 kernel_w: 3 stride_h: 1 stride_w: 2 }";
  expect_near(run("Pooling", max, {1, 1, 1, 4}, {1, 5, 2, 4}), {5, 4});
  const std::string ave =
      "pooling_param { pool: AVE kernel_h: 1 kernel_w: 3 stride_h: 1 stride_w: 2 }";
  expect_near(run("Pooling", ave, {1, 1, 1, 4}, {1, 5, 2, 4}), {8.0F / 3, 3}, 1e-6F);
  const std::string floor =
      "pooling_param { kernel_h: 1 kernel_w: 3 stride_h: 1 stride_w: 2 round_mode: FLOOR }";
  expect_near(run("Pooling", floor, {1, 1, 1, 4}, {1, 5, 2, 4}), {5});
}

TEST(Pooling, PaddingNeverWinsAndCountsInTheAverage) {
  const std::string pad = "kernel_size: 2 stride: 2 pad: 1 }";
  // 2x2 with pad 1: windows hold one pixel each.
  expect_near(run("Pooling", "pooling_param { pool: MAX " + pad, {1, 1, 2, 2}, {-1, -2, -3, -4}),
              {-1, -2, -3, -4});
  expect_near(run("Pooling", "pooling_param { pool: AVE " + pad, {1, 1, 2, 2}, {4, 8, 12, 16}),
              {1, 2, 3, 4});
}

TEST(Pooling, NanNeverWinsAndAnEmptyMaximumIsTheSmallestFloat) {
  expect_near(run("Pooling", "pooling_param { kernel_size: 2 }", {1, 1, 2, 2}, {kNan, 1, 0, kNan}),
              {1});
  expect_near(
      run("Pooling", "pooling_param { kernel_size: 2 }", {1, 1, 2, 2}, {kNan, kNan, kNan, kNan}),
      {-FLT_MAX});
}

TEST(Pooling, GlobalTakesTheWholeImage) {
  Shape shape;
  expect_near(run("Pooling", "pooling_param { pool: AVE global_pooling: true }", {1, 2, 2, 2},
                  {1, 2, 3, 6, -1, -1, -1, -1}, {}, &shape),
              {3, -1});
  EXPECT_EQ(shape, (Shape{1, 2, 1, 1}));
}

TEST(Pooling, OneOfBothForms) {
  const auto window = [](const std::string& kernel) {
    return layer_of("Pooling", "pooling_param { " + kernel + " }")->window(Shape{1, 1, 9, 9})->h;
  };
  EXPECT_EQ(window("kernel_size: 3 kernel_h: 5").extent, 3);
  EXPECT_EQ(window("kernel_size: 3 kernel_w: 5").extent, 3);
  EXPECT_EQ(window("kernel_w: 3 kernel_h: 5").extent, 5);
  for (const char* kernel : {"kernel_size: 3 kernel_h: 5 kernel_w: 5", "kernel_h: 5", ""})
    expect_error<InputError>([&] { window(kernel); }, {"give kernel_size, or both"});
}

TEST(Pooling, MaskIsTheIndexInTheImage) {
  const auto outputs = test::run_checked("Pooling", "pooling_param { kernel_size: 2 stride: 2 }",
                                         {{Shape{1, 1, 2, 4}, {1, 2, 9, 3, 4, 0, 5, 6}}}, {}, 2);
  expect_near(outputs[0].values, {4, 9});
  expect_near(outputs[1].values, {4, 2});
}

TEST(Lrn, AcrossChannels) {
  // size 3, alpha 3, beta 1, k 2: y = x / (2 + sum of squares of the neighbors)
  const std::string param = "lrn_param { local_size: 3 alpha: 3 beta: 1 k: 2 }";
  expect_near(run("LRN", param, {1, 3, 1, 1}, {1, 2, 3}), {1.0F / 7, 2.0F / 16, 3.0F / 15}, 1e-7F);
  // beta 0.75 has its own implementation: 16 ^ -0.75 = 1 / 8
  const std::string usual = "lrn_param { local_size: 3 alpha: 3 beta: 0.75 k: 2 }";
  expect_near(run("LRN", usual, {1, 3, 1, 1}, {1, 2, 3}),
              {std::pow(7.0F, -0.75F), 2.0F / 8, 3 * std::pow(15.0F, -0.75F)}, 1e-6F);
}

TEST(Lrn, WithinChannelIgnoresKAndCountsPadding) {
  // 3x3 window over 1x2: mean of squares = (1 + 4) / 9 everywhere; y = x / (1 + 9 * 5 / 9)
  const std::string param =
      "lrn_param { local_size: 3 alpha: 9 beta: 1 k: 100 norm_region: WITHIN_CHANNEL }";
  expect_near(run("LRN", param, {1, 1, 1, 2}, {1, 2}), {1.0F / 6, 2.0F / 6}, 1e-7F);
}

TEST(Convolution, OutputSizeTruncatesTowardZero) {
  // Kernel 3 on one row, stride 4: (1 - 3) / 4 + 1 = 1; the missing rows read as zero.
  Shape shape;
  expect_near(run("Convolution", "convolution_param { num_output: 1 kernel_size: 3 stride: 4 }",
                  {1, 1, 1, 1}, {2}, {{3, 1, 1, 1, 1, 1, 1, 1, 1}, {0.5F}}, &shape),
              {6.5F});
  EXPECT_EQ(shape, (Shape{1, 1, 1, 1}));
}

TEST(Convolution, OneDimensional) {
  expect_near(run("Convolution",
                  "convolution_param { num_output: 1 kernel_size: 2 pad: 1 bias_term: false }",
                  {1, 1, 3}, {1, 2, 3}, {{10, 1}}),
              {1, 12, 23, 30});
}

TEST(Convolution, Groups) {
  expect_near(run("Convolution",
                  "convolution_param { num_output: 2 kernel_size: 1 group: 2 bias_term: false }",
                  {1, 2, 1, 2}, {1, 2, 3, 4}, {{10, 100}}),
              {10, 20, 300, 400});
}

TEST(InnerProduct, BothOrdersOfWeights) {
  expect_near(run("InnerProduct", "inner_product_param { num_output: 2 }", {1, 3}, {1, 2, 3},
                  {{1, 0, 0, 1, 1, 1}, {0.5F, -1}}),
              {1.5F, 5});
  expect_near(
      run("InnerProduct", "inner_product_param { num_output: 2 transpose: true bias_term: false }",
          {1, 3}, {1, 2, 3}, {{1, 1, 0, 1, 0, 1}}),
      {1, 6});
}

TEST(Softmax, SumsToOneAlongItsAxisAndSurvivesLargeValues) {
  const auto found =
      run("Softmax", "softmax_param { axis: 1 }", {1, 2, 2}, {1000, 0, 1000, std::log(3.0F)});
  expect_near(found, {0.5F, 0.25F, 0.5F, 0.75F}, 1e-6F);
}

TEST(Concat, AlongAnyAxis) {
  const std::string param = "concat_param { axis: -1 }";
  const auto output =
      test::run_checked("Concat", param, {{Shape{2, 1}, {1, 2}}, {Shape{2, 2}, {3, 4, 5, 6}}})[0];
  EXPECT_EQ(output.shape, (Shape{2, 3}));
  expect_near(output.values, {1, 3, 4, 2, 5, 6});
  EXPECT_THROW(layer_of("Concat", param)->infer({Shape{2, 1}, Shape{3, 2}}, 1), InputError);
}

TEST(Flatten, MergesARangeOfAxes) {
  EXPECT_EQ(layer_of("Flatten", "")->infer({Shape{2, 3, 4, 5}}, 1)[0], (Shape{2, 60}));
  EXPECT_EQ(layer_of("Flatten", "flatten_param { axis: 1 end_axis: 2 }")
                ->infer({Shape{2, 3, 4, 5}}, 1)[0],
            (Shape{2, 12, 5}));
  const auto between = [](const std::string& end_axis) {
    return layer_of("Flatten", "flatten_param { axis: 2 end_axis: " + end_axis + " }")
        ->infer({Shape{2, 3, 4, 5}}, 1)[0];
  };
  EXPECT_EQ(between("1"), (Shape{2, 3, 1, 4, 5}));
  expect_error<InputError>([&] { between("0"); }, {"end_axis 0 comes before axis 2"});
}

TEST(Layers, RejectInvalidParameters) {
  expect_rejected<UnsupportedError>("Convolutoin", "", {}, {"did you mean 'Convolution'"});
  expect_error<InputError>([] { layer_of("", ""); }, {"has no type"});
  expect_error<InputError>(
      [] {
        layer_of("Convolution", "convolution_param { num_output: 1 kernel_size: 3 hole_h: 2 }")
            ->weight_shapes({Shape{1, 1, 8, 8}});
      },
      {"both hole_h and hole_w"});
  // A layer that reads data, for which deploy files have an Input layer.
  expect_rejected<UnsupportedError>("MolGridReader", "top: 'data'", {},
                                    {"'MolGridReader'", "write an Input layer"});
  expect_rejected("Convolution", "convolution_param { num_output: 3 group: 2 }", {},
                  {"multiple of group"});
  expect_error<InputError>([] { layer_of("LRN", "lrn_param { local_size: 4 }"); }, {"odd"});
  expect_rejected("LRN", "lrn_param { local_size: 4294967295 }", {},
                  {"local_size must be at most 2147483647, found 4294967295"});
  expect_rejected("Pooling", "pooling_param { kernel_size: 2 pad: 2 }", {}, {"pad 2"});
  expect_rejected("Convolution", "convolution_param { num_output: 1 kernel_size: 9 }",
                  {Shape{1, 1, 4, 4}}, {"spans 9", "empty"});
  expect_rejected(
      "Convolution",
      "convolution_param { num_output: 1 kernel_size: 4294967295 dilation: 4294967295 }",
      {Shape{1, 1, 4, 4}}, {"kernel size is too large: 4294967295"});
}

}  // namespace
}  // namespace revisit::engine
