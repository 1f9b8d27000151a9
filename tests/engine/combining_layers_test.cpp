#include "checked_layer.h"
#include "testing.h"

namespace revisit::engine {
namespace {

std::vector<float> eltwise(const std::string& param,
                           const std::vector<std::vector<float>>& inputs) {
  std::vector<Tensor> tensors;
  for (const auto& values : inputs)
    tensors.push_back({Shape{static_cast<int64_t>(values.size())}, values});
  return run_checked("Eltwise", "eltwise_param { " + param + " }", tensors)[0].values;
}

TEST(Eltwise, SumsWithCoefficients) {
  expect_near(eltwise("", {{1, 2}, {10, 20}, {100, kInf}}), {111, kInf});
  expect_near(eltwise("coeff: 2 coeff: -1", {{1, 2}, {10, 20}}), {-8, -16});
  expect_near(eltwise("coeff: 0 coeff: 1", {{kNan, kInf}, {10, 20}}), {10, 20});
}

TEST(Eltwise, Multiplies) {
  expect_near(eltwise("operation: PROD", {{1, 2, 0}, {10, 20, kInf}, {3, -1, 1}}), {30, -40, kNan});
}

TEST(Eltwise, MaximumTreatsNanAsCaffe) {
  // `a > b ? a : b` for the first two, `c > best` for the others.
  expect_near(eltwise("operation: MAX", {{1, kNan, 1, kNan, -kInf}, {2, 1, kNan, kNan, -kInf}}),
              {2, 1, kNan, kNan, -kInf});
  expect_near(eltwise("operation: MAX", {{1, kNan, 1}, {2, 1, 0}, {3, kNan, kNan}}), {3, 1, 1});
}

TEST(Eltwise, AnInputMayComeTwice) {
  // In a net the two share memory, and the output may overwrite it: every input is read first.
  const auto layer = layer_of("Eltwise", "eltwise_param { operation: PROD }");
  const std::vector<Shape> shapes(3, Shape{2500}), outputs{Shape{2500}};
  const Kernel kernel = layer->bind({shapes, outputs, {}, 2, false});
  std::vector<float> a(2500, 3), b(2500, 2);
  kernel.run({{a.data(), b.data(), a.data()}, {a.data()}, nullptr});
  EXPECT_EQ(a, std::vector<float>(2500, 18));
}

TEST(Eltwise, RejectsUnequalShapes) {
  const Shape shape{2, 3};
  expect_rejected("Eltwise", "eltwise_param { operation: PROD coeff: 1 coeff: 1 }", {},
                  {"coeff", "SUM"});
  expect_rejected("Eltwise", "eltwise_param { coeff: 1 }", {shape, shape},
                  {"one coeff for each of 2 inputs, found 1"});
  const auto sum = layer_of("Eltwise", "");
  expect_error<InputError>([&] { sum->infer({shape, Shape{3, 2}}, 1); }, {"2x3", "3x2"});
  expect_error<InputError>([&] { sum->infer({shape}, 1); }, {"at least 2 inputs"});
}

TEST(Reduction, OverTheLastAxes) {
  const std::vector<float> x{1, -2, 3, 4, -5, 6};
  const auto reduce = [&](const std::string& param, Shape* shape = nullptr) {
    return run("Reduction", "reduction_param { " + param + " }", {2, 3}, x, {}, shape);
  };
  Shape shape;
  expect_near(reduce("axis: 1", &shape), {2, 5});
  EXPECT_EQ(shape, Shape{2});
  expect_near(reduce("", &shape), {7});
  EXPECT_EQ(shape, Shape{});
  expect_near(reduce("axis: -1 operation: ASUM"), {6, 15});
  expect_near(reduce("axis: 1 operation: SUMSQ coeff: 0.5"), {7, 38.5F});
  expect_near(reduce("axis: 1 operation: MEAN coeff: 3"), {2, 5}, 1e-6F);
  expect_error<InputError>([&] { reduce("axis: 2"); }, {"axis 2", "2x3"});
}

TEST(EuclideanLoss, IsHalfTheSquaredDistanceOfAnImage) {
  const Tensor a{Shape{2, 2}, {1, 2, 3, 4}}, b{Shape{2, 1, 2}, {0, 2, 6, 8}};
  const Tensor loss = run_checked("EuclideanLoss", "", {a, b})[0];
  EXPECT_EQ(loss.shape, Shape{});
  expect_near(loss.values, {(1 + 9 + 16) / 4.0F});
  const auto infer = [](const std::vector<Shape>& inputs) {
    layer_of("EuclideanLoss", "")->infer(inputs, 1);
  };
  expect_error<InputError>([&] { infer({Shape{2, 2}, Shape{4, 1}}); }, {"2x2", "4x1"});
  expect_error<InputError>([&] { infer({Shape{2, 2}, Shape{2, 3}}); }, {"2x2", "2x3"});
  expect_error<InputError>([&] { infer({Shape{2, 2}}); }, {"2 inputs", "found 1"});
}

TEST(ArgMax, OfAllValuesOfAnImage) {
  const std::vector<float> x{1, 5, 5, 0, 9, 2, 3, 9};
  Shape shape;
  // Equal values: the later one comes first, as in Caffe.
  expect_near(run("ArgMax", "argmax_param { top_k: 3 }", {2, 2, 2}, x, {}, &shape),
              {2, 1, 0, 3, 0, 2});
  EXPECT_EQ(shape, (Shape{2, 1, 3}));
  expect_near(run("ArgMax", "argmax_param { top_k: 2 out_max_val: true }", {2, 4}, x, {}, &shape),
              {2, 1, 5, 5, 3, 0, 9, 9});
  EXPECT_EQ(shape, (Shape{2, 2, 2}));
  run("ArgMax", "", {2, 1, 2, 2}, x, {}, &shape);
  EXPECT_EQ(shape, (Shape{2, 1, 1, 1}));
}

TEST(ArgMax, AlongAnAxis) {
  const std::vector<float> x{1, 6, 5, 2, 3, 4};  // 1 x 3 x 2
  Shape shape;
  expect_near(run("ArgMax", "argmax_param { axis: 1 top_k: 2 }", {1, 3, 2}, x, {}, &shape),
              {1, 0, 2, 2});
  EXPECT_EQ(shape, (Shape{1, 2, 2}));
  expect_near(run("ArgMax", "argmax_param { axis: -2 out_max_val: true }", {1, 3, 2}, x, {}),
              {5, 6});
}

TEST(ArgMax, RefusesMoreThanThereIs) {
  expect_error<InputError>([] { layer_of("ArgMax", "argmax_param { top_k: 0 }"); }, {"top_k"});
  expect_rejected("ArgMax", "argmax_param { top_k: 7 }", {Shape{9, 2, 3}}, {"top_k 7", "6 values"});
  expect_rejected("ArgMax", "argmax_param { top_k: 3 axis: 1 }", {Shape{9, 2, 3}},
                  {"top_k 3", "2 values"});
  expect_rejected("ArgMax", "argmax_param { axis: 3 }", {Shape{9, 2, 3}}, {"axis 3"});
  expect_rejected("ArgMax", "", {Shape{}}, {"one axis"});
}

}  // namespace
}  // namespace revisit::engine
