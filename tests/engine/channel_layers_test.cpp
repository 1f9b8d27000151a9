#include "checked_layer.h"
#include "testing.h"

namespace revisit::engine {
namespace {

TEST(PReLU, OneSlopePerChannelOrOneForAll) {
  const std::vector<float> x{-1, 2, -3, 4, -kInf, kNan, -2, kInf};
  expect_near(run("PReLU", "", {2, 2, 2}, x, {{0.5F, 10}}),
              {-0.5F, 2, -30, 4, -kInf, kNan, -20, kInf});
  expect_near(run("PReLU", "prelu_param { channel_shared: true }", {2, 2, 2}, x, {{0.5F}}),
              {-0.5F, 2, -1.5F, 4, -kInf, kNan, -1, kInf});
  expect_near(run("PReLU", "", {2, 2}, {-1, -1, 1, -2}, {{3, 4}}), {-3, -4, 1, -8});
  EXPECT_EQ(
      layer_of("PReLU", "prelu_param { channel_shared: true }")->weight_shapes({Shape{2, 2}})[0],
      Shape{});
  expect_rejected("PReLU", "", {Shape{3}}, {"2 axes"});
  expect_near(run("PReLU", "", {1, 2, 1, 1, 2}, {-1, 2, -3, 4}, {{0.5F, 10}}), {-0.5F, 2, -30, 4});
}

/// Fused kernels keep positive values unchanged, which would hide a diverged slope.
TEST(PReLU, IsMergedWhereItsSlopesAreFinite) {
  const auto layer = layer_of("PReLU", "");
  const auto form = [&](float slope) {
    return layer->form({Shape{1, 2, 3, 3}}, {{Shape{2}, {0.5F, slope}}});
  };
  EXPECT_TRUE(std::holds_alternative<Activating>(form(3)));
  for (const float slope : {kNan, kInf, -kInf}) {
    EXPECT_TRUE(std::holds_alternative<std::monostate>(form(slope))) << slope;
    expect_near(run("PReLU", "", {1, 2}, {1, 1}, {{0.5F, slope}}), {1, kNan});
  }
}

TEST(Scale, AlongAnyRangeOfAxes) {
  const std::vector<float> x{1, 2, 3, 4, 5, 6, 7, 8};
  const Shape shape{2, 2, 2};
  expect_near(run("Scale", "", shape, x, {{10, 100}}), {10, 20, 300, 400, 50, 60, 700, 800});
  expect_near(run("Scale", "scale_param { axis: -1 }", shape, x, {{10, 100}}),
              {10, 200, 30, 400, 50, 600, 70, 800});
  expect_near(run("Scale", "scale_param { axis: 0 num_axes: 2 }", shape, x, {{0, 1, 2, 3}}),
              {0, 0, 3, 4, 10, 12, 21, 24});
  expect_near(
      run("Scale", "scale_param { axis: 0 num_axes: -1 }", shape, x, {{1, 0, 1, 0, 1, 0, 1, 0}}),
      {1, 0, 3, 0, 5, 0, 7, 0});
  expect_near(run("Scale", "scale_param { num_axes: 0 }", shape, x, {{2}}),
              {2, 4, 6, 8, 10, 12, 14, 16});
}

TEST(Scale, AddsALearnedBias) {
  expect_near(run("Scale", "scale_param { bias_term: true }", {1, 2, 2}, {1, 2, 3, 4},
                  {{10, 100}, {1, -1}}),
              {11, 21, 299, 399});
}

TEST(Scale, TakesTheScaleFromASecondInput) {
  const Tensor x{Shape{2, 2, 2}, {1, 2, 3, 4, 5, 6, 7, 8}};
  expect_near(
      run_checked("Scale", "scale_param { axis: 0 }", {x, {Shape{2, 2}, {0, 1, 2, 3}}})[0].values,
      {0, 0, 3, 4, 10, 12, 21, 24});
  expect_near(run_checked("Scale", "scale_param { axis: 7 }", {x, {Shape{}, {2}}})[0].values,
              {2, 4, 6, 8, 10, 12, 14, 16});
  // A bias then has the shape of the second input.
  expect_near(run_checked("Scale", "scale_param { bias_term: true }", {x, {Shape{2}, {10, 100}}},
                          {{1, -1}})[0]
                  .values,
              {11, 21, 299, 399, 51, 61, 699, 799});
}

TEST(Scale, RunsOfAnyLength) {
  for (const Shape& shape : {Shape{3, 7, 1}, Shape{20000, 3, 1}, Shape{2, 3, 17001}}) {
    std::vector<float> x(static_cast<size_t>(shape.elements())), scale, wanted;
    for (size_t i = 0; i < x.size(); ++i) x[i] = static_cast<float>(i % 1000);
    for (int64_t c = 0; c < shape[1]; ++c) scale.push_back(static_cast<float>(c) - 1.5F);
    for (int64_t n = 0, i = 0; n < shape[0]; ++n)
      for (int64_t c = 0; c < shape[1]; ++c)
        for (int64_t k = 0; k < shape[2]; ++k, ++i) wanted.push_back(x[i] * scale[c]);
    EXPECT_EQ(run("Scale", "", shape, x, {scale}), wanted) << shape;
  }
}

TEST(Bias, IsBroadcastAsScaleIs) {
  const Tensor x{Shape{1, 2, 2}, {1, 2, 3, 4}};
  expect_near(run("Bias", "", x.shape, x.values, {{10, 100}}), {11, 12, 103, 104});
  expect_near(run("Bias", "bias_param { axis: 2 }", x.shape, x.values, {{10, 100}}),
              {11, 102, 13, 104});
  expect_near(run_checked("Bias", "", {x, {Shape{2, 2}, {1, 2, 3, 4}}})[0].values, {2, 4, 6, 8});
}

TEST(ScaleAndBias, RejectOtherShapes) {
  for (const auto& [type, param] : {std::pair{"Scale", "scale_param"}, {"Bias", "bias_param"}}) {
    const auto infer = [&, t = std::string(type), p = std::string(param)](
                           const std::string& given, const std::vector<Shape>& inputs) {
      layer_of(t, p + " {" + given + "}")->infer(inputs, 1);
    };
    expect_error<InputError>([&] { infer("axis: 3", {Shape{1, 2, 3}}); }, {"axis 3", "1x2x3"});
    expect_error<InputError>([&] { infer("num_axes: 3", {Shape{1, 2, 3}}); }, {"reach past"});
    expect_error<InputError>([&] { infer("num_axes: -2", {Shape{1, 2, 3}}); }, {"num_axes"});
    expect_error<InputError>(
        [&] {
          infer("", {Shape{1, 2, 3}, Shape{3}});
        },
        {"second input (3)", "1x2x3"});
    expect_error<InputError>([&] { infer("", {Shape{1, 2}, Shape{2, 1}}); }, {"second input"});
    expect_error<InputError>([&] { infer("", {}); }, {"1 or 2 inputs"});
    expect_error<InputError>(
        [&] {
          infer("", {Shape{1, 2}, Shape{2}, Shape{2}});
        },
        {"1 or 2 inputs"});
  }
}

TEST(BatchNorm, DividesTheStoredSumsByTheirWeight) {
  // Mean 2 and 0, variance 4 and 1, both stored times 10.
  const std::string param = "batch_norm_param { eps: 0 }";
  expect_near(run("BatchNorm", param, {1, 2, 2}, {2, 6, 3, kInf}, {{20, 0}, {40, 10}, {10}}),
              {0, 2, 3, kInf}, 1e-6F);
  // A weight of 0: no samples.
  expect_near(
      run("BatchNorm", "batch_norm_param { eps: 0.25 }", {1, 1, 2}, {2, 6}, {{20}, {40}, {0}}),
      {4, 12});
}

/// NVIDIA's fork: statistics are not divided, and fillers switch scale and bias on.
TEST(BatchNorm, WithScaleAndBias) {
  for (const char* param :
       {"scale_bias: true use_global_stats: false", "scale_filler { value: 1 }", "bias_filler {}"})
    expect_near(run("BatchNorm", str("batch_norm_param { eps: 0.25 ", param, " }"), {1, 2, 2},
                    {2, 6, 3, 1}, {{4, 1}, {3.75F, 0}, {10}, {3, 2}, {-1, 0.5F}}),
                {-4, 2, 8.5F, 0.5F});
  EXPECT_EQ(layer_of("BatchNorm", "batch_norm_param { scale_bias: true } param {}")
                ->weight_shapes({Shape{1, 2}})
                .size(),
            5U);
  const auto form = layer_of("BatchNorm", "batch_norm_param { eps: 0.25 scale_bias: true }")
                        ->form({Shape{1, 1, 2, 2}}, {{Shape{1}, {4}},
                                                     {Shape{1}, {3.75F}},
                                                     {Shape{1}, {0}},
                                                     {Shape{1}, {3}},
                                                     {Shape{1}, {-1}}});
  const auto* affine = std::get_if<ChannelAffine>(&form);
  ASSERT_TRUE(affine);
  EXPECT_NEAR(affine->scale[0], 1.5, 1e-6);
  EXPECT_NEAR(affine->shift[0], -7, 1e-6);
}

TEST(BatchNorm, OfTheBatchWhenAskedFor) {
  // Channel 0 holds 1, 3, 5, 7 (mean 4, variance 5), channel 1 a constant.
  expect_near(run("BatchNorm", "batch_norm_param { use_global_stats: false eps: 4 }", {2, 2, 2},
                  {1, 3, 9, 9, 5, 7, 9, 9}, {{0, 0}, {0, 0}, {0}}),
              {-1, -1.0F / 3, 0, 0, 1.0F / 3, 1, 0, 0}, 1e-7F);
}

TEST(BatchNorm, OfTheBatchInThePhaseTrain) {
  const std::vector<float> x{1, 3, 10, 30};
  const std::vector<std::vector<float>> weights{{100, 100}, {1, 1}, {1}};
  const auto normalized = [&](const std::string& param) {
    return run("BatchNorm", "batch_norm_param { eps: 0 " + param, {1, 2, 2}, x, weights);
  };
  expect_near(normalized("} phase: TRAIN"), {-1, 1, -1, 1}, 1e-6F);
  expect_near(normalized("} phase: TEST"), {-99, -97, -90, -70});
  expect_near(normalized("use_global_stats: true } phase: TRAIN"), {-99, -97, -90, -70});
}

TEST(BatchNorm, RefusesLearningRatesAndSingleAxes) {
  expect_error<InputError>([] { layer_of("BatchNorm", "param { lr_mult: 1 }"); }, {"lr_mult"});
  layer_of("BatchNorm", "param { lr_mult: 0 }");
  layer_of("BatchNorm", "param {} param {} param {}");  // older nets
  expect_rejected("BatchNorm", "", {Shape{3}}, {"2 axes"});
}

TEST(Bn, OfPspNetHasSlopeBiasMeanAndVariance) {
  // Mean 2 and 0, variance 3 and 0, with eps 4 and 1.
  const std::string param = "bn_param { slope_filler { value: 1 } frozen: true eps: 1 }";
  expect_near(run("BN", param, {1, 2, 2}, {2, 6, 3, kInf}, {{10, 4}, {100, -1}, {2, 0}, {3, 0}}),
              {100, 120, 11, kInf});
  expect_near(run("BN", "", {1, 1, 1, 1}, {6}, {{1}, {0}, {2}, {0}}), {4 / std::sqrt(1e-5F)},
              1e-3F);
  EXPECT_EQ(layer_of("BN", "")->weight_shapes({Shape{2, 5, 3, 3}}),
            std::vector<Shape>(4, Shape{1, 5, 1, 1}));
}

TEST(Bn, OfSegNetHasScaleAndShift) {
  expect_near(run("BN", "bn_param { bn_mode: INFERENCE scale_filler { value: 1 } }", {1, 2, 2},
                  {1, 2, 3, kInf}, {{10, 4}, {100, -1}}),
              {110, 120, 11, kInf});
  EXPECT_EQ(
      layer_of("BN", "bn_param { shift_filler { value: 0 } }")->weight_shapes({Shape{2, 5, 3, 3}}),
      std::vector<Shape>(2, Shape{1, 5, 1, 1}));
}

TEST(Bn, OfSegNetTakesTheStatisticsOfTheBatchUnlessToldNotTo) {
  // Channel 0 holds 1, 3, 5, 7 (mean 4, variance 5), channel 1 zeros.
  const float far = 3 / std::sqrt(5.0F), near = 1 / std::sqrt(5.0F);
  for (const std::string param :
       {"bn_param { bn_mode: LEARN }", "bn_param { scale_filler { value: 1 } }"})
    expect_near(run("BN", param, {2, 2, 2}, {1, 3, 0, 0, 5, 7, 0, 0}, {{10, 1}, {100, 2}}),
                {100 - 10 * far, 100 - 10 * near, 2, 2, 100 + 10 * near, 100 + 10 * far, 2, 2},
                1e-5F);
}

TEST(Bn, RefusesFieldsOfBothForks) {
  expect_rejected("BN", "bn_param { frozen: true bn_mode: LEARN }", {}, {"SegNet", "PSPNet"});
  expect_rejected("BN", "", {Shape{3}}, {"2 axes"});
  expect_error<UnsupportedError>([] { layer_of("BN", "phase: TRAIN"); }, {"TRAIN", "bn_mode"});
}

TEST(Mvn, PerChannelOrAcross) {
  const std::vector<float> x{1, 3, 10, 30};
  const Shape shape{1, 2, 1, 2};
  expect_near(run("MVN", "", shape, x), {-1, 1, -1, 1}, 1e-6F);
  expect_near(run("MVN", "mvn_param { normalize_variance: false }", shape, x), {-1, 1, -10, 10});
  expect_near(run("MVN", "mvn_param { normalize_variance: false across_channels: true }", shape, x),
              {-10, -8, -1, 19});
  // eps is added to the deviation, not to the variance.
  expect_near(run("MVN", "mvn_param { eps: 1 }", shape, x), {-0.5F, 0.5F, -10.0F / 11, 10.0F / 11},
              1e-6F);
  expect_near(run("MVN", "", {2, 2}, x), {0, 0, 0, 0});  // a channel is one value
  EXPECT_EQ(layer_of("MVN", "")->infer({Shape{2, 2}}, 1)[0], (Shape{2, 2, 1, 1}));
  EXPECT_EQ(layer_of("MVN", "")->infer({Shape{1, 2, 2}}, 1)[0], (Shape{1, 2, 2, 1}));
  expect_rejected("MVN", "", {Shape{1, 1, 1, 1, 1}}, {"4 axes"});
}

TEST(Normalization, OverTheImageSeesAllOfIt) {
  const Shape shape{1, 4, 5, 6};
  EXPECT_FALSE(layer_of("MVN", "")->window(shape));
  EXPECT_TRUE(layer_of("BatchNorm", "")->window(shape));
  EXPECT_FALSE(
      layer_of("BatchNorm", "batch_norm_param { use_global_stats: false }")->window(shape));
}

TEST(Axpy, OneFactorPerImageAndChannel) {
  const Tensor x{Shape{2, 1, 1, 2}, {1, 2, 3, kNan}}, y{Shape{2, 1, 1, 2}, {10, 20, 30, 40}};
  for (const Shape& shape : {Shape{2, 1}, Shape{2, 1, 1, 1}})
    expect_near(run_checked("Axpy", "", {{shape, {5, 0}}, x, y})[0].values, {15, 30, 30, 40});
  const auto axpy = layer_of("Axpy", "");
  expect_error<InputError>(
      [&] {
        axpy->infer({Shape{1, 1}, x.shape, y.shape}, 1);
      },
      {"n x c", "2x1x1x2", "1x1"});
  expect_error<InputError>([&] { axpy->infer({x.shape, x.shape, y.shape}, 1); }, {"n x c"});
  expect_error<InputError>(
      [&] {
        axpy->infer({Shape{2, 1}, x.shape, Shape{2, 1, 2, 1}}, 1);
      },
      {"same shape"});
  expect_error<InputError>([&] { axpy->infer({Shape{2, 1}, x.shape}, 1); }, {"3 inputs"});
}

/// Either input may have the factors.
TEST(Mul, OneFactorPerImageAndChannel) {
  const Tensor maps{Shape{2, 2, 1, 2}, {1, 2, 3, 4, 5, 6, 7, kInf}},
      factors{Shape{2, 2, 1, 1}, {10, 0, -1, 0}};
  const std::vector<float> wanted{10, 20, 0, 0, -5, -6, 0, kNan};
  for (const auto& inputs : {std::vector{maps, factors}, {factors, maps}}) {
    const auto found = run_checked("Mul", "", inputs);
    EXPECT_EQ(found[0].shape, maps.shape);
    expect_near(found[0].values, wanted);
  }
  for (const Shape& other : {Shape{1, 2, 1, 1}, Shape{2, 2}, Shape{2, 2, 1, 2}})
    expect_rejected<UnsupportedError>("Mul", "", {maps.shape, other}, {"n x c x 1 x 1", "2x2x1x2"});
}

}  // namespace
}  // namespace revisit::engine
