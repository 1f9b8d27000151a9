#include "checked_layer.h"
#include "kernels/convolution.h"
#include "single_layer.h"
#include "testing.h"

namespace revisit::engine {
namespace {

TEST(ConvolutionNd, ThreeDimensionalByHand) {
  // A 2x2x2 kernel on a 2x2x3 image: two windows, which differ by one step along the last axis.
  const auto outputs = run_layer({"Convolution",
                                  "convolution_param { num_output: 1 kernel_size: 2 }",
                                  {{Shape{1, 1, 2, 2, 3}, {1, 2, 3, 4, 5, 6, 7, 8, 9, 0, 1, 2}}},
                                  {{1, 10, 100, 1000, 1, 1, 1, 1}, {0.5F}}});
  EXPECT_EQ(outputs[0].shape, (Shape{1, 1, 1, 1, 2}));
  // 1 + 20 + 400 + 5000 + 7 + 8 + 0 + 1, and 2 + 30 + 500 + 6000 + 8 + 9 + 1 + 2
  expect_near(outputs[0].values, {5437.5F, 6552.5F});
}

TEST(ConvolutionNd, WithoutSpatialAxesItIsAProductOverTheChannels) {
  const auto outputs =
      run_layer({"Convolution",
                 "convolution_param { num_output: 2 kernel_size: 3 axis: 1 bias_term: false }",
                 {{Shape{2, 2}, {1, 2, 3, 4}}},
                 {{1, 10, 100, 1000}}});
  EXPECT_EQ(outputs[0].shape, (Shape{2, 2}));
  expect_near(outputs[0].values, {21, 2100, 43, 4300});
}

TEST(ConvolutionNd, ParametersRepeatPerAxis) {
  EXPECT_EQ(layer_of("Convolution",
                     "convolution_param { num_output: 4 kernel_size: [1, 2, 3] stride: [1, 2, 1] "
                     "pad: [0, 0, 1] dilation: [1, 1, 2] }")
                ->infer({Shape{2, 3, 5, 6, 7}}, 1)[0],
            (Shape{2, 4, 5, 3, 5}));
}

TEST(ConvolutionNd, RejectsInvalidParameters) {
  const auto infer = [](const std::string& param, const Shape& input) {
    return [=] {
      layer_of("Convolution", "convolution_param { num_output: 4 " + param + " }")
          ->infer({input}, 1);
    };
  };
  expect_error<InputError>(infer("", {1, 1, 4, 4}), {"kernel size must be given"});
  expect_error<InputError>(infer("kernel_h: 2", {1, 1, 4, 4}), {"kernel size must be at least 1"});
  expect_error<InputError>(infer("kernel_size: [1, 1]", {1, 1, 4, 4, 4}),
                           {"given 2 times", "3 spatial axes"});
  expect_error<InputError>(infer("kernel_h: 2 kernel_w: 2", {1, 1, 4, 4, 4}), {"2 spatial axes"});
  expect_error<InputError>(infer("kernel_size: 2 stride: 0", {1, 1, 4, 4}), {"stride"});
  expect_error<InputError>(infer("kernel_size: 4000000000 dilation: 4000000000", {1, 1, 4, 4}),
                           {"too large"});
  expect_error<InputError>(infer("kernel_size: 5", {1, 1, 4, 4, 4}), {"spans 5", "empty"});
}

struct NdCase {
  const char* name;
  ConvolutionNdProblem problem;
};

/// Computes as many windows as fit; some problems do not reach the end of the image.
ConvolutionNdProblem make(int64_t n, int64_t c_image, int64_t c_windows, int64_t group,
                          WindowAxes axes) {
  ConvolutionNdProblem p{n, c_image, c_windows, group, std::move(axes)};
  for (WindowAxis& axis : p.axes)
    axis.windows =
        (axis.image + 2 * axis.pad - axis.dilation * (axis.kernel - 1) - 1) / axis.stride + 1;
  return p;
}

std::vector<NdCase> nd_cases() {
  // axis: image, windows (computed), kernel, stride, pad, dilation
  return {
      {"point", make(2, 3, 4, 1, {})},
      {"line", make(2, 3, 5, 1, {{37, 0, 4, 3, 2, 1}})},
      {"plane_k4s2p1", make(1, 6, 8, 2, {{14, 0, 4, 2, 1, 1}, {18, 0, 4, 2, 1, 1}})},
      {"plane_odd", make(3, 4, 6, 2, {{9, 0, 3, 2, 0, 2}, {11, 0, 2, 3, 1, 1}})},
      {"plane_depthwise", make(1, 16, 16, 16, {{12, 0, 3, 1, 1, 1}, {13, 0, 3, 1, 1, 1}})},
      {"plane_gap", make(1, 2, 3, 1, {{11, 0, 2, 4, 0, 1}, {10, 0, 1, 3, 0, 1}})},
      {"plane_many_blocks", make(1, 70, 8, 1, {{8, 0, 5, 1, 2, 1}, {9, 0, 5, 1, 2, 1}})},
      {"plane_many_strips", make(1, 10, 3, 1, {{60, 0, 7, 1, 3, 1}, {62, 0, 7, 1, 3, 1}})},
      {"volume", make(2, 4, 6, 2, {{5, 0, 2, 1, 1, 1}, {6, 0, 3, 2, 0, 1}, {7, 0, 2, 1, 0, 2}})},
      {"four_axes",
       make(1, 2, 3, 1,
            {{3, 0, 2, 1, 0, 1}, {4, 0, 2, 2, 1, 1}, {3, 0, 3, 1, 1, 1}, {5, 0, 2, 1, 0, 1}})},
  };
}

int64_t image_floats(const ConvolutionNdProblem& p) {
  return p.n * p.c_image * p.image_pixels();
}
int64_t window_floats(const ConvolutionNdProblem& p) {
  return p.n * p.c_windows * p.windows();
}

std::vector<float> run(const ConvolutionNdKernel& kernel, const ConvolutionNdProblem& p,
                       int64_t outputs, const std::vector<float>& input,
                       const std::vector<float>& weights, const float* bias) {
  std::vector<float> output(static_cast<size_t>(outputs), std::numeric_limits<float>::quiet_NaN());
  std::vector<float> scratch(static_cast<size_t>(kernel.scratch_floats(p)));
  if (!scratch.empty()) std::memset(scratch.data(), 0xA5, scratch.size() * sizeof(float));
  kernel.run(p, input.data(), weights.data(), bias, output.data(), scratch.data());
  return output;
}

class NdKernels : public testing::TestWithParam<NdCase> {
 protected:
  static constexpr unsigned kSeed = 20260612;

  static void compare(const ConvolutionNdKernel& fast, const ConvolutionNdKernel& slow,
                      int64_t n_input, int64_t n_output, int64_t n_bias) {
    SCOPED_TRACE(testing::Message() << fast.name << ", seed " << kSeed);
    ConvolutionNdProblem p = GetParam().problem;
    const auto input = random_floats(n_input, kSeed);
    const auto weights = random_floats(p.c_windows * p.depth(), kSeed + 1);
    const auto bias = random_floats(n_bias, kSeed + 2);
    for (const float* b : {bias.data(), static_cast<const float*>(nullptr)}) {
      p.threads = 1;
      const auto wanted = run(slow, p, n_output, input, weights, b);
      const auto one = run(fast, p, n_output, input, weights, b);
      EXPECT_LE(relative_error(one, wanted), 5e-6);
      for (const int threads : {2, 3, 7}) {
        p.threads = threads;
        EXPECT_EQ(run(fast, p, n_output, input, weights, b), one) << threads << " threads";
      }
    }
  }
};

TEST_P(NdKernels, ConvolutionAgreesWithTheDefinition) {
  const ConvolutionNdProblem& p = GetParam().problem;
  for (const ConvolutionNdKernel& kernel : convolution_kernels())
    if (kernel.supports(p))
      compare(kernel, kConvolutionReference, image_floats(p), window_floats(p), p.c_windows);
}

TEST_P(NdKernels, DeconvolutionAgreesWithTheDefinition) {
  const ConvolutionNdProblem& p = GetParam().problem;
  compare(kDeconvolutionGemm, kDeconvolutionReference, window_floats(p), image_floats(p),
          p.c_image);
}

TEST_P(NdKernels, DeconvolutionIsTheAdjointOfConvolution) {
  const ConvolutionNdProblem& p = GetParam().problem;
  const auto x = random_floats(image_floats(p), kSeed),
             y = random_floats(window_floats(p), kSeed + 1);
  const auto weights = random_floats(p.c_windows * p.depth(), kSeed + 2);
  const auto inner = [](const std::vector<float>& a, const std::vector<float>& b) {
    return std::inner_product(a.begin(), a.end(), b.begin(), 0.0);
  };
  const auto conv_x = run(kConvolutionReference, p, window_floats(p), x, weights, nullptr);
  const auto deconv_y = run(kDeconvolutionGemm, p, image_floats(p), y, weights, nullptr);
  const double scale = std::sqrt(inner(conv_x, conv_x) * inner(y, y));
  EXPECT_NEAR(inner(conv_x, y), inner(x, deconv_y), 1e-6 * scale) << "seed " << kSeed;
}

INSTANTIATE_TEST_SUITE_P(Problems, NdKernels, testing::ValuesIn(nd_cases()),
                         [](const auto& instance) { return std::string(instance.param.name); });

TEST(ConvolutionNd, TwoAxesAgreeWithThePlanarKernels) {
  const auto x = random_floats(2 * 4 * 9 * 11, 1), w = random_floats(6 * 2 * 3 * 2, 2),
             b = random_floats(6, 3);
  const auto plane = run_layer(
      {"Convolution",
       "convolution_param { num_output: 6 group: 2 kernel_size: [3, 2] stride: 2 pad: 1 }",
       {{Shape{2, 4, 9, 11}, x}},
       {w, b}});
  const auto volume =
      run_layer({"Convolution",
                 "convolution_param { num_output: 6 group: 2 kernel_size: [1, 3, 2] "
                 "stride: [1, 2, 2] pad: [0, 1, 1] }",
                 {{Shape{2, 4, 1, 9, 11}, x}},
                 {w, b}});
  EXPECT_LE(relative_error(volume[0].values, plane[0].values), 1e-6);
}

TEST(Deconvolution, ByHand) {
  // Stride 2, kernel 3: each value spreads over three; the middle one gets both.
  const auto outputs = run_layer({"Deconvolution",
                                  "convolution_param { num_output: 1 kernel_size: 3 stride: 2 }",
                                  {{Shape{1, 1, 2}, {1, 10}}},
                                  {{1, 2, 3}, {0.5F}}});
  EXPECT_EQ(outputs[0].shape, (Shape{1, 1, 5}));
  expect_near(outputs[0].values, {1.5F, 2.5F, 13.5F, 20.5F, 30.5F});
}

TEST(Deconvolution, PaddingCutsOffTheRim) {
  const auto outputs =
      run_layer({"Deconvolution",
                 "convolution_param { num_output: 1 kernel_size: 3 pad: 1 bias_term: false }",
                 {{Shape{1, 1, 1, 2}, {1, 10}}},
                 {{1, 2, 3, 4, 5, 6, 7, 8, 9}}});
  EXPECT_EQ(outputs[0].shape, (Shape{1, 1, 1, 2}));
  expect_near(outputs[0].values, {5 + 40, 6 + 50});
}

TEST(Deconvolution, GroupsAndDilation) {
  const auto outputs = run_layer(
      {"Deconvolution",
       "convolution_param { num_output: 4 group: 2 kernel_size: 2 dilation: 2 bias_term: false }",
       {{Shape{1, 2, 1}, {1, 10}}},
       {{1, 2, 3, 4, 5, 6, 7, 8}}});
  EXPECT_EQ(outputs[0].shape, (Shape{1, 4, 3}));
  expect_near(outputs[0].values, {1, 0, 2, 3, 0, 4, 50, 0, 60, 70, 0, 80});
}

TEST(Deconvolution, KeepsNanAndInfinityWhereTheyBelong) {
  const auto outputs =
      run_layer({"Deconvolution",
                 "convolution_param { num_output: 1 kernel_size: 2 stride: 3 bias_term: false }",
                 {{Shape{1, 1, 3}, {kNan, 1, kInf}}},
                 {{1, 2}}});
  expect_near(outputs[0].values, {kNan, kNan, 0, 1, 2, 0, kInf, kInf});
}

TEST(Deconvolution, RejectsInvalidParameters) {
  expect_rejected("Deconvolution", "convolution_param { num_output: 1 kernel_size: 2 pad: 1 }",
                  {Shape{1, 1, 1, 1}}, {"padding", "empty"});
  expect_rejected("Deconvolution", "convolution_param { num_output: 4 kernel_size: 1 group: 4 }",
                  {Shape{1, 6, 2, 2}}, {"6 channels", "group 4"});
  expect_rejected("Deconvolution", "convolution_param { num_output: 3 kernel_size: 1 group: 2 }",
                  {}, {"multiple of group"});
  expect_rejected("Deconvolution",
                  "convolution_param { num_output: 1 kernel_size: 2 stride: 2000000000 }",
                  {Shape{1, 1, 9, 9}}, {"more than"});
}

TEST(Windows, PadsOfBothEndsMayDiffer) {
  // Windows of three of four pixels, two apart.
  const auto run = [](const std::string& type, const std::string& param,
                      std::vector<std::vector<float>> weights) {
    return run_layer({type, param, {{Shape{1, 1, 1, 4}, {-1, -2, -3, -4}}}, std::move(weights)})[0]
        .values;
  };
  const std::string sizes = "kernel_h: 1 kernel_w: 3 stride_h: 1 stride_w: 2 pad_h: 0 pad_b: 0 ";
  const auto convolved = [&](const std::string& pads) {
    return run("Convolution",
               "convolution_param { num_output: 1 bias_term: false " + sizes + pads + " }",
               {{1, 10, 100}});
  };
  const auto pooled = [&](const std::string& pads) {
    return run("Pooling", "pooling_param { " + sizes + pads + " }", {});
  };
  expect_near(convolved("pad_w: 0 pad_r: 1"), {-321, -43});
  expect_near(convolved("pad_w: 1 pad_r: 0"), {-210, -432});
  expect_near(pooled("pad_w: 0 pad_r: 1"), {-1, -3});
  expect_near(pooled("pad_w: 1 pad_r: 0"), {-1, -2});
  expect_near(pooled("pool: AVE pad_w: 0 pad_r: 1"), {-2, -7.F / 3});
  expect_near(pooled("pool: AVE pad_w: 1 pad_r: 0"), {-1, -3});
  expect_near(pooled("pool: AVE_EXC_PAD pad_w: 0 pad_r: 1"), {-2, -3.5F});
  expect_near(pooled("pool: AVE_EXC_PAD pad_w: 1 pad_r: 0"), {-1.5F, -3});
  for (const char* pads :
       {"pad_l: 1 pad: 1", "pad: 1 pad_b: 1 pad_r: 2", "pad_h: 1 pad_w: 1 pad_b: 2"})
    for (const auto& [type, param] :
         {std::pair{"Convolution", "convolution_param { num_output: 1 kernel_size: 3 "},
          {"Pooling", "pooling_param { kernel_size: 3 "}})
      expect_rejected(type, std::string(param) + pads + " }", {Shape{1, 1, 9, 9}},
                      {"pad_l, pad_r, pad_t and pad_b"});
  expect_rejected("Pooling",
                  "pooling_param { global_pooling: true pad_h: 0 pad_w: 0 pad_b: 1 pad_r: 1 }",
                  {Shape{1, 1, 9, 9}}, {"no pad"});
}

TEST(Windows, PadsOfBothEndsAreNotThoseOfVolumes) {
  const std::string pads = "kernel_size: 3 pad_h: 1 pad_w: 1 pad_b: 1 pad_r: 2";
  for (const auto& [type, param] :
       {std::pair{"Convolution", "convolution_param { num_output: 1 " + pads + " }"},
        {"Pooling", "pooling_param { pad_nd: [1, 1, 1] " + pads + " }"}})
    expect_rejected(type, param, {Shape{1, 1, 9, 9, 9}}, {"2 spatial axes"});
}

TEST(Im2col, WritesTheWindowsOut) {
  const auto outputs = run_layer({"Im2col",
                                  "convolution_param { kernel_size: 2 pad: 1 stride: 2 }",
                                  {{Shape{1, 1, 2, 2}, {1, 2, 3, 4}}}});
  EXPECT_EQ(outputs[0].shape, (Shape{1, 4, 2, 2}));
  expect_near(outputs[0].values, {0, 0, 0, 4, 0, 0, 3, 0, 0, 2, 0, 0, 1, 0, 0, 0});
  expect_rejected("Im2col", "convolution_param { kernel_size: 1 }", {Shape{2, 3}},
                  {"at least one axis"});
}

TEST(Depthwise, GroupsByChannelUnlessTold) {
  const Tensor input{Shape{1, 2, 1, 2}, {1, 2, 3, 4}};
  const auto found =
      run_layer({"DepthwiseConvolution",
                 "convolution_param { num_output: 2 kernel_size: 1 bias_term: false }",
                 {input},
                 {{10, 100}}});
  expect_near(found[0].values, {10, 20, 300, 400});
  const auto plain =
      run_layer({"DepthwiseConvolution",
                 "convolution_param { num_output: 1 group: 1 kernel_size: 1 bias_term: false }",
                 {input},
                 {{10, 100}}});
  expect_near(plain[0].values, {310, 420});
  expect_rejected("DepthwiseConvolution", "convolution_param { num_output: 3 kernel_size: 1 }",
                  {Shape{1, 2, 1, 2}}, {"num_output 3", "group 2"});
}

TEST(Depthwise, TheOtherForkTakesNoNumberOfOutputs) {
  const auto found = run_layer({"ConvolutionDepthwise",
                                "convolution_param { kernel_size: [1, 2] group: 1 }",
                                {{Shape{1, 2, 1, 2}, {1, 2, 3, 4}}},
                                {{1, 10, 100, 1000}, {0.5F, 0.25F}}});
  EXPECT_EQ(found[0].shape, (Shape{1, 2, 1, 1}));
  expect_near(found[0].values, {21.5F, 4300.25F});
}

struct VolumeAxis {
  int64_t size, kernel, stride, pad;
  int64_t windows() const {
    int64_t n = (size + 2 * pad - kernel + stride - 1) / stride + 1;
    return n;
  }
};

/// Slow twin, from the definition in docs/reference/LAYERS.md points 1 and 2.
std::vector<float> pooled(const std::vector<float>& volume, const std::vector<VolumeAxis>& axes,
                          const Shape& out, bool is_max) {
  std::vector<float> result;
  for (int64_t i = 0; i < out.elements(); ++i) {
    const int64_t at[] = {i / (out[4] * out[3]) % out[2], i / out[4] % out[3], i % out[4]};
    double sum = 0, best = -kInf;
    int64_t area = 1;
    for (int64_t a = 0; a < 3; ++a) {
      const int64_t start = at[a] * axes[a].stride - axes[a].pad;
      area *= std::min(start + axes[a].kernel, axes[a].size + axes[a].pad) - start;
    }
    const int64_t n_volume = i / (out[4] * out[3] * out[2]) * axes[0].size;
    for (int64_t k = 0; k < axes[0].kernel * axes[1].kernel * axes[2].kernel; ++k) {
      const int64_t tap[] = {k / (axes[2].kernel * axes[1].kernel),
                             k / axes[2].kernel % axes[1].kernel, k % axes[2].kernel};
      int64_t pixel = 0;
      bool inside = true;
      for (int64_t a = 0; a < 3; ++a) {
        const int64_t x = at[a] * axes[a].stride - axes[a].pad + tap[a];
        inside &= x >= 0 && x < axes[a].size;
        pixel = (a == 0 ? n_volume : pixel * axes[a].size) + x;
      }
      if (!inside) continue;
      sum += volume[pixel];
      best = std::max(best, double{volume[pixel]});
    }
    result.push_back(static_cast<float>(is_max ? best : sum / static_cast<double>(area)));
  }
  return result;
}

TEST(PoolingNd, VolumesAgreeWithTheDefinition) {
  struct Case {
    const char* param;
    std::vector<VolumeAxis> axes;
    Shape out;
  };
  for (const Case& c : std::vector<Case>{
           {"kernel_size: 2 stride: 2",
            {{4, 2, 2, 0}, {5, 2, 2, 0}, {6, 2, 2, 0}},
            {2, 3, 2, 3, 3}},
           {"kernel_size_nd: [1, 2, 3] stride_nd: [1, 2, 1] pad: 0",
            {{4, 1, 1, 0}, {5, 2, 2, 0}, {6, 3, 1, 0}},
            {2, 3, 4, 3, 4}},
           {"kernel_size: 3 stride: 2 pad: 1",
            {{4, 3, 2, 1}, {5, 3, 2, 1}, {6, 3, 2, 1}},
            {2, 3, 3, 3, 4}},
           {"kernel_size: 2 pad_nd: [0, 1, 0] round_mode: FLOOR stride: 2",
            {{4, 2, 2, 0}, {5, 2, 2, 1}, {6, 2, 2, 0}},
            {2, 3, 2, 3, 3}},
           {"global_pooling: true", {{4, 4, 1, 0}, {5, 5, 1, 0}, {6, 6, 1, 0}}, {2, 3, 1, 1, 1}}})
    for (const bool is_max : {true, false}) {
      SCOPED_TRACE(c.param);
      const std::vector<float> x = random_floats(2 * 3 * 4 * 5 * 6, 1);
      Shape shape;
      const auto found = test::run(
          "Pooling", str("pooling_param { pool: ", is_max ? "MAX " : "AVE ", c.param, " }"),
          {2, 3, 4, 5, 6}, x, {}, &shape);
      EXPECT_EQ(shape, c.out);
      expect_near(found, pooled(x, c.axes, c.out, is_max), is_max ? 0 : 1e-6F);
    }
}

TEST(PoolingNd, MaskWindowAndRejections) {
  const Tensor x{Shape{1, 1, 2, 2, 2}, {0, 1, 2, 3, 9, 5, 6, 7}};
  const auto found = test::run_checked("Pooling", "pooling_param { kernel_size: 2 }", {x}, {}, 2);
  EXPECT_EQ(found[0].values, std::vector<float>{9});
  EXPECT_EQ(found[1].values, std::vector<float>{4});
  const auto window = layer_of("Pooling", "pooling_param { kernel_size_nd: [1, 2, 3] }")
                          ->window(Shape{1, 1, 4, 4, 4});
  EXPECT_EQ(window->h.extent, 2);
  EXPECT_EQ(window->w.extent, 3);
  for (const auto& [param, part] :
       {std::pair{"kernel_h: 2 kernel_w: 2", "2 spatial axes"},
        {"kernel_size_nd: [1, 2]", "2 times; expected once, or once for each of 3"},
        {"kernel_size: 5", "does not fit into 4"}})
    expect_rejected("Pooling", str("pooling_param { ", param, " }"), {Shape{1, 1, 4, 4, 4}},
                    {part});
  expect_rejected("Pooling", "pooling_param { kernel_size: 1 }", {Shape{1, 1, 4}},
                  {"5 for volumes"});
}

}  // namespace
}  // namespace revisit::engine
