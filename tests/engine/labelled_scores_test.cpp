#include "checked_layer.h"
#include "testing.h"

namespace revisit::engine {
namespace {

const Tensor kScores{Shape{3, 3}, {1, 2, 3, 5, 4, 3, 7, 7, 6}};

std::vector<Tensor> accuracy(const std::string& param, const std::vector<float>& labels,
                             size_t n_outputs = 1) {
  return run_checked("Accuracy", "accuracy_param { " + param + " }", {kScores, {Shape{3}, labels}},
                     {}, n_outputs);
}

TEST(Accuracy, CountsLabelsWithTheBestScore) {
  EXPECT_EQ(accuracy("", {2, 0, 2})[0].shape, Shape{});
  expect_near(accuracy("", {2, 0, 2})[0].values, {2.0F / 3});
  expect_near(accuracy("", {2, 1, 0})[0].values, {1.0F / 3});  // equal scores: none is best
  expect_near(accuracy("top_k: 2", {1, 2, 0})[0].values, {2.0F / 3});
  expect_near(accuracy("top_k: 3", {0, 1, 2})[0].values, {1});
}

TEST(Accuracy, OfEachClass) {
  const std::vector<Tensor> out = accuracy("", {2, 0, 2}, 2);
  expect_near(out[0].values, {2.0F / 3});
  expect_near(out[1].values, {1, 0, 0.5F});
}

TEST(Accuracy, LabelsThatDoNotCount) {
  expect_near(accuracy("ignore_label: 2", {2, 0, 1})[0].values, {0.5F});
  expect_near(accuracy("ignore_label: -1", {-1, -1, -1})[0].values, {0});
  for (const float label : {3.0F, -1.0F, kNan, 1e30F}) {
    const std::vector<Tensor> out = accuracy("", {2, 0, label}, 2);
    expect_near(out[0].values, {kNan});
    expect_near(out[1].values, {kNan, kNan, kNan});
  }
}

TEST(Accuracy, AlongAnyAxis) {
  const Tensor scores{Shape{1, 2, 3}, {1, 5, 9, 2, 4, 8}};  // classes on axis 1
  expect_near(run_checked("Accuracy", "", {scores, {Shape{1, 1, 3}, {1, 0, 1}}})[0].values,
              {2.0F / 3});
  expect_near(
      run_checked("Accuracy", "accuracy_param { axis: -1 }", {scores, {Shape{2}, {2, 2}}})[0]
          .values,
      {1});
}

TEST(SoftmaxWithLoss, MeanOfTheLogarithms) {
  const float a = std::log(3.0F);  // softmax of (0, 0, log 3, ...) in fifths
  const Tensor scores{Shape{2, 3}, {0, 0, a, a, 0, 0}};
  const auto loss = [&](const std::string& param, const std::vector<float>& labels) {
    return run_checked("SoftmaxWithLoss", "loss_param { " + param + " }",
                       {scores, {Shape{2, 1}, labels}}, {}, 2);
  };
  const float likely = -std::log(0.6F), unlikely = -std::log(0.2F);
  const std::vector<Tensor> out = loss("", {2, 1});
  EXPECT_EQ(out[0].shape, Shape{});
  expect_near(out[0].values, {(likely + unlikely) / 2}, 1e-6F);
  expect_near(out[1].values, {0.2F, 0.2F, 0.6F, 0.6F, 0.2F, 0.2F}, 1e-6F);

  expect_near(loss("ignore_label: 1", {2, 1})[0].values, {likely}, 1e-6F);
  expect_near(loss("ignore_label: 1 normalization: FULL", {2, 1})[0].values, {likely / 2}, 1e-6F);
  expect_near(loss("ignore_label: 1 normalize: false", {2, 1})[0].values, {likely / 2}, 1e-6F);
  expect_near(loss("normalization: NONE", {2, 1})[0].values, {likely + unlikely}, 1e-6F);
  expect_near(loss("ignore_label: 7", {7, 7})[0].values, {0});
  expect_near(loss("", {2, 3})[0].values, {kNan});
}

TEST(SoftmaxWithLoss, ImpossibleLabelsCostTheLogarithmOfTheSmallestNumber) {
  const std::vector<Tensor> out =
      run_checked("SoftmaxWithLoss", "", {{Shape{1, 2}, {1000, 0}}, {Shape{1}, {1}}});
  expect_near(out[0].values, {-std::log(1.17549435e-38F)}, 1e-4F);
}

TEST(LabeledScores, RejectOtherShapes) {
  for (const std::string type : {"Accuracy", "SoftmaxWithLoss"}) {
    const auto infer = [&](const std::vector<Shape>& inputs, size_t n_outputs) {
      layer_of(type, "")->infer(inputs, n_outputs);
    };
    expect_error<InputError>([&] { infer({Shape{2, 3}, Shape{3}}, 1); }, {"need 2 labels", "3"});
    expect_error<InputError>([&] { infer({Shape{2, 3}}, 1); }, {"inputs"});
    expect_error<InputError>([&] { infer({Shape{2, 3}, Shape{2}}, 3); }, {"outputs"});
    expect_error<InputError>([&] { infer({Shape{2}, Shape{2}}, 1); }, {"axis 1 is out of range"});
  }
  const auto first_axes = [](const std::string& type) {
    layer_of(type, "")->infer({Shape{2, 3, 2}, Shape{4}}, 1);
  };
  first_axes("Accuracy");
  expect_error<InputError>([&] { first_axes("SoftmaxWithLoss"); },
                           {"agree in the first axis, found 2x3x2 and 4"});
  expect_error<InputError>([] { accuracy("top_k: 4", {0, 0, 0}); }, {"top_k 4", "3 classes"});
}

}  // namespace
}  // namespace revisit::engine
