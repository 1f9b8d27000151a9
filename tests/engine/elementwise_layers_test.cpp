#include "checked_layer.h"
#include "testing.h"

namespace revisit::engine {
namespace {

std::vector<float> of(const std::string& type, const std::string& param,
                      const std::vector<float>& x) {
  return run(type, param, {static_cast<int64_t>(x.size())}, x);
}

TEST(AbsVal, IsTheMagnitude) {
  expect_near(of("AbsVal", "", {-2, 0, 3, -kInf, kNan}), {2, 0, 3, kInf, kNan});
}

TEST(Bnll, IsTheLogOfOnePlusExp) {
  const float ln2 = std::log(2.0F);
  expect_near(of("BNLL", "", {0, 1000, -1000, kInf, -kInf}), {ln2, 1000, 0, kInf, 0}, 1e-7F);
  expect_near(of("BNLL", "", {1, -1}), {1.3132617F, 0.3132617F}, 1e-6F);
  EXPECT_GT(of("BNLL", "", {-20})[0], 2e-9F);  // computed in double, so it does not vanish
}

TEST(Clip, NanBecomesTheMinimum) {
  expect_near(of("Clip", "clip_param { min: -1 max: 2 }", {-3, 0.5F, 3, kInf, -kInf, kNan}),
              {-1, 0.5F, 2, 2, -1, -1});
}

TEST(Elu, SaturatesAtMinusAlpha) {
  expect_near(of("ELU", "", {2, 0, -1, -kInf, kInf, kNan}),
              {2, 0, std::exp(-1.0F) - 1, -1, kInf, kNan}, 1e-7F);
  expect_near(of("ELU", "elu_param { alpha: 0.5 }", {-kInf, 3}), {-0.5F, 3});
}

TEST(Exp, AnyBase) {
  expect_near(of("Exp", "", {0, 1, -kInf}), {1, std::exp(1.0F), 0}, 1e-6F);
  // 2 ^ (1 + 0.5 x)
  expect_near(of("Exp", "exp_param { base: 2 scale: 0.5 shift: 1 }", {0, 2, -2}), {2, 4, 1}, 1e-6F);
  expect_near(of("Exp", "exp_param { shift: 2 }", {-2}), {1}, 1e-6F);
}

TEST(HardSwish, IsXTimesAClippedLine) {
  expect_near(run("HardSwish", "", {7}, {-4, -3, -1.5F, 0, 1.5F, 3, 4}),
              {0, 0, -0.375F, 0, 1.125F, 3, 4});
}

TEST(Log, AnyBase) {
  expect_near(of("Log", "", {1, 0, -1, kInf}), {0, -kInf, kNan, kInf});
  // log2(2 x + 1)
  expect_near(of("Log", "log_param { base: 2 scale: 2 shift: 1 }", {0, 0.5F, 3.5F}), {0, 1, 3},
              1e-6F);
}

TEST(ExpAndLog, RefuseBasesWithoutALogarithm) {
  for (const char* base : {"-2", "0", "inf", "nan"}) {
    const std::string given = "{ base: " + std::string(base) + " }";
    expect_error<InputError>([&] { layer_of("Exp", "exp_param " + given); }, {"base", "positive"});
    expect_error<InputError>([&] { layer_of("Log", "log_param " + given); }, {"base", "positive"});
  }
  expect_error<InputError>([] { layer_of("Log", "log_param { base: 1 }"); }, {"base", "1"});
}

TEST(Power, ShiftScalePower) {
  expect_near(of("Power", "power_param { power: 2 scale: 0.5 shift: 1 }", {0, 2, -6}), {1, 4, 4});
  expect_near(of("Power", "power_param { scale: -2 shift: 1 }", {0, 3, kInf}), {1, -5, -kInf});
  expect_near(of("Power", "power_param { power: 3 }", {-2}), {-8});
  expect_near(of("Power", "power_param { power: 0.5 }", {4, -1}), {2, kNan});
}

TEST(Power, WithoutAShiftTheSignOfZeroStays) {
  expect_near(of("Power", "power_param { power: -1 }", {-0.0F, 0.0F}), {-kInf, kInf});
}

TEST(Power, AProductOfZeroIgnoresTheInput) {
  expect_near(of("Power", "power_param { power: 2 scale: 0 shift: 3 }", {1, kNan}), {9, 9});
  expect_near(of("Power", "power_param { power: 0 scale: 2 shift: 3 }", {1, kNan}), {1, 1});
}

TEST(ReLU6, SaturatesAtSix) {
  expect_near(of("ReLU6", "", {-1, 0, 5, 6, 7, kInf}), {0, 0, 5, 6, 6, 6});
  expect_near(of("ReLU6", "relu6_param { negative_slope: 0.5 }", {-2, 7}), {-1, 6});
  expect_near(of("ReLU6", "relu_param { negative_slope: 0.5 }", {-2, 7}), {-1, 6});
}

/// Caffe's expressions also multiply the 0 of positive numbers by the slope.
TEST(ReluAndElu, ASlopeThatIsNotFiniteShowsEverywhere) {
  for (const char* slope : {"inf", "nan"}) {
    expect_near(of("ReLU", str("relu_param { negative_slope: ", slope, " }"), {2, 0}),
                {kNan, kNan});
    expect_near(of("ELU", str("elu_param { alpha: ", slope, " }"), {2, 0}), {kNan, kNan});
  }
}

TEST(Sigmoid, IsZeroAndOneFarOut) {
  expect_near(of("Sigmoid", "", {0, kInf, -kInf, 500, -500, kNan}), {0.5F, 1, 0, 1, 0, kNan});
  expect_near(of("Sigmoid", "", {std::log(3.0F)}), {0.75F}, 1e-7F);
}

TEST(Swish, IsXTimesSigmoid) {
  const float ln3 = std::log(3.0F);
  expect_near(of("Swish", "", {0, ln3}), {0, 0.75F * ln3}, 1e-6F);
  expect_near(of("Swish", "swish_param { beta: 2 }", {ln3 / 2}), {0.75F * ln3 / 2}, 1e-6F);
}

TEST(Mish, IsXTimesTanhOfSoftplus) {
  // x = ln 3: 1 + 3 = 4, tanh(ln 4) = 15 / 17; x = -ln 3: 1 + 1/3 = 4/3, tanh(ln 4/3) = 7 / 25.
  const float ln3 = std::log(3.0F);
  expect_near(of("Mish", "", {0, ln3, -ln3}), {0, ln3 * 15 / 17, -ln3 * 7 / 25}, 1e-7F);
  expect_near(of("Mish", "", {100, 1e30F, kInf, -100, -kInf, kNan}),
              {100, 1e30F, kInf, 0, kNan, kNan}, 1e-30F);
}

TEST(Dropout, IsNothingAtInference) {
  expect_near(of("Dropout", "dropout_param { dropout_ratio: 0.75 }", {1, -2, kNan}), {1, -2, kNan});
}

TEST(Dropout, WithoutScaleTrainScalesByTheKeptShare) {
  expect_near(
      of("Dropout", "dropout_param { dropout_ratio: 0.5 scale_train: false }", {1, 2, 3, 4}),
      {0.5F, 1, 1.5F, 2});
  expect_near(of("Dropout", "dropout_param { dropout_ratio: 0.75 scale_train: false }", {4, -8}),
              {1, -2});
}

TEST(Dropout, SampledKeepsAShareAndScalesIt) {
  const std::string param = "dropout_param { dropout_ratio: 0.75 sample_weights_test: true }";
  const std::vector<float> ones(40'000, 1);
  const auto pass = [&](int passes, int threads) {
    test::SingleLayer layer{"Dropout", param, {{Shape{40'000}, ones}}};
    layer.passes = passes;
    layer.threads = threads;
    return test::run_layer(layer)[0].values;
  };
  const std::vector<float> first = pass(1, 1);
  const auto n_kept = std::ranges::count(first, 4.0F);
  EXPECT_EQ(n_kept + std::ranges::count(first, 0.0F), 40'000);
  EXPECT_NEAR(static_cast<double>(n_kept), 10'000, 350);  // four deviations
  EXPECT_EQ(first, pass(1, 3));
  EXPECT_NE(first, pass(2, 1));
  EXPECT_EQ(pass(2, 1), pass(2, 4));
  expect_rejected("Dropout", "dropout_param { dropout_ratio: 1 sample_weights_test: true }", {},
                  {"dropout_ratio"});
}

TEST(TanH, OfLogTwo) {
  expect_near(of("TanH", "", {0, std::log(2.0F), kInf, -kInf}), {0, 0.6F, 1, -1}, 1e-7F);
}

TEST(Threshold, IsStrict) {
  expect_near(of("Threshold", "threshold_param { threshold: 0.5 }", {0.5F, 0.6F, -1, kNan}),
              {0, 1, 0, 0});
}

TEST(Elementwise, LargeArraysAreCoveredWhole) {
  std::vector<float> x(70001);
  for (size_t i = 0; i < x.size(); ++i) x[i] = 0.001F * static_cast<float>(i) - 30;
  for (const std::string type : {"AbsVal", "BNLL", "ELU", "Exp", "Sigmoid", "TanH", "Threshold"}) {
    const std::vector<float> y = of(type, "", x);
    for (size_t i = 0; i < x.size(); i += 777)
      EXPECT_EQ(y[i], of(type, "", {x[i]})[0]) << type << " of " << x[i];
    EXPECT_EQ(y.back(), of(type, "", {x.back()})[0]) << type;
  }
}

TEST(Elementwise, KeepsAnyShapeAndTakesOneInput) {
  EXPECT_EQ(layer_of("TanH", "")->infer({Shape{2, 3, 1, 4, 5}}, 1)[0], (Shape{2, 3, 1, 4, 5}));
  EXPECT_EQ(layer_of("TanH", "")->infer({Shape{}}, 1)[0], Shape{});
  expect_rejected("TanH", "", {Shape{1}, Shape{1}}, {"expected 1 inputs, found 2"});
}

}  // namespace
}  // namespace revisit::engine
