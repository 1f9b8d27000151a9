// LSTM and RNN against the equations, with weights in the original's order.
#include <gtest/gtest.h>

#include <cmath>

#include "expect_error.h"
#include "simd_targets.h"
#include "single_layer.h"

namespace revisit::engine {
namespace {

using test::expect_error;
using test::expect_near;
using test::layer_of;
using test::random_floats;
using test::run_layer;
using test::sigmoid;

/// The equations of one LSTM layer, written for one stream and then looped, in double precision.
struct SlowLstm {
  int64_t steps, streams, input, output, fixed;
  std::vector<float> x, cont, x_static, xc, bc, x_c_static, hc;

  std::vector<float> run(std::vector<float>& h, std::vector<float>& c) const {
    std::vector<float> y(static_cast<size_t>(steps * streams * output));
    for (int64_t n = 0; n < streams; ++n)
      for (int64_t t = 0; t < steps; ++t) {
        const double keep = cont[t * streams + n];
        std::vector<double> gates(static_cast<size_t>(4 * output));
        for (int64_t g = 0; g < 4 * output; ++g) {
          double sum = bc[g];
          for (int64_t i = 0; i < input; ++i)
            sum += xc[g * input + i] * x[(t * streams + n) * input + i];
          for (int64_t i = 0; i < fixed; ++i)
            sum += x_c_static[g * fixed + i] * x_static[n * fixed + i];
          for (int64_t i = 0; i < output; ++i) sum += hc[g * output + i] * keep * h[n * output + i];
          gates[g] = sum;
        }
        for (int64_t d = 0; d < output; ++d) {
          float& cell = c[n * output + d];
          cell = static_cast<float>(keep * sigmoid(gates[output + d]) * cell +
                                    sigmoid(gates[d]) * std::tanh(gates[3 * output + d]));
          h[n * output + d] = static_cast<float>(sigmoid(gates[2 * output + d]) * std::tanh(cell));
          y[(t * streams + n) * output + d] = h[n * output + d];
        }
      }
    return y;
  }
};

SlowLstm random_lstm(int64_t fixed, int64_t output = 2) {
  SlowLstm l{5, 3, 4, output, fixed, {}, {}, {}, {}, {}, {}, {}};
  l.x = random_floats(5 * 3 * 4, 1);
  l.cont = {0, 1, 1, 1, 1, 0, 1, 0, 1, 1, 1, 1, 1, 0.5F, 1};
  l.x_static = random_floats(3 * fixed, 2);
  l.xc = random_floats(4 * output * 4, 3);
  l.bc = random_floats(4 * output, 4);
  l.x_c_static = random_floats(4 * output * fixed, 5);
  l.hc = random_floats(4 * output * output, 6);
  return l;
}

TEST(Lstm, ByHand) {
  // One step, one unit, no memory: c = sigmoid(i) tanh(g), h = sigmoid(o) tanh(c).
  const auto found = run_layer({"LSTM",
                                "recurrent_param { num_output: 1 }",
                                {{Shape{1, 1, 1}, {2}}, {Shape{1, 1}, {0}}},
                                {{1, 5, -1, 0.5F}, {0, 0, 1, 0}, {9, 9, 9, 9}}});
  EXPECT_EQ(found[0].shape, (Shape{1, 1, 1}));
  const double c = sigmoid(2) * std::tanh(1);
  expect_near(found[0].values, {static_cast<float>(sigmoid(-1) * std::tanh(c))}, 1e-7F);
}

TEST(Lstm, FollowsTheEquationsAndRemembersBetweenPasses) {
  const SlowLstm l = random_lstm(0);
  std::vector<float> h(6, 0), c(6, 0), wanted;
  for (const int passes : {1, 2, 3}) {
    wanted = l.run(h, c);
    const auto found = run_layer({.type = "LSTM",
                                  .param = "recurrent_param { num_output: 2 }",
                                  .inputs = {{Shape{5, 3, 2, 2}, l.x}, {Shape{5, 3}, l.cont}},
                                  .weights = {l.xc, l.bc, l.hc},
                                  .threads = passes,
                                  .passes = passes});
    EXPECT_EQ(found[0].shape, (Shape{5, 3, 2}));
    expect_near(found[0].values, wanted, 1e-6F);
  }
}

TEST(Lstm, UnitsThatDoAndDoNotFillAVector) {
  for (const int64_t units : {1, 15, 16, 37}) {
    const SlowLstm l = random_lstm(0, units);
    std::vector<float> h(static_cast<size_t>(3 * units), 0), c = h;
    const std::vector<float> wanted = l.run(h, c);
    test::for_each_simd_target([&] {
      const auto found = run_layer({.type = "LSTM",
                                    .param = str("recurrent_param { num_output: ", units, " }"),
                                    .inputs = {{Shape{5, 3, 4}, l.x}, {Shape{5, 3}, l.cont}},
                                    .weights = {l.xc, l.bc, l.hc}});
      expect_near(found[0].values, wanted, 1e-6F);
    });
  }
}

TEST(Lstm, StaticInputAndExposedState) {
  const SlowLstm l = random_lstm(3);
  std::vector<float> h = random_floats(6, 7), c = random_floats(6, 8);
  const std::vector<Tensor> inputs{{Shape{5, 3, 4}, l.x},
                                   {Shape{5, 3}, l.cont},
                                   {Shape{3, 3}, l.x_static},
                                   {Shape{1, 3, 2}, h},
                                   {Shape{1, 3, 2}, c}};
  const auto found = run_layer({.type = "LSTM",
                                .param = "recurrent_param { num_output: 2 expose_hidden: true }",
                                .inputs = inputs,
                                .weights = {l.xc, l.bc, l.x_c_static, l.hc},
                                .n_outputs = 3,
                                .passes = 2});  // nothing is remembered: the state is an input
  expect_near(found[0].values, l.run(h, c), 1e-6F);
  expect_near(found[1].values, h, 1e-6F);
  expect_near(found[2].values, c, 1e-6F);
}

TEST(Lstm, ANewSequenceForgets) {
  const auto found = run_layer({.type = "LSTM",
                                .param = "recurrent_param { num_output: 1 expose_hidden: true }",
                                .inputs = {{Shape{1, 1, 1}, {2}},
                                           {Shape{1, 1}, {0}},
                                           {Shape{1, 1, 1}, {7}},
                                           {Shape{1, 1, 1}, {8}}},
                                .weights = {{1, 5, -1, 0.5F}, {0, 0, 1, 0}, {9, 9, 9, 9}},
                                .n_outputs = 3});
  const double c = sigmoid(2) * std::tanh(1);
  expect_near(found[2].values, {static_cast<float>(c)}, 1e-7F);
}

TEST(Rnn, ByHand) {
  // h1 = tanh(2 x1), h2 = tanh(2 x2 + 0.5 h1 + 1 * static), o = tanh(3 h - 1); cont cuts at t = 1.
  const auto found =
      run_layer({"RNN",
                 "recurrent_param { num_output: 1 }",
                 {{Shape{2, 1, 1}, {0.25F, -0.5F}}, {Shape{2, 1}, {0, 1}}, {Shape{1, 1}, {0.125F}}},
                 {{2}, {0.5F}, {4}, {0.75F}, {3}, {-1}}});
  const double h1 = std::tanh(0.5 + 0.5 + 0.5), h2 = std::tanh(-1.0 + 0.5 + 0.5 + 0.75 * h1);
  expect_near(
      found[0].values,
      {static_cast<float>(std::tanh(3 * h1 - 1)), static_cast<float>(std::tanh(3 * h2 - 1))},
      1e-6F);
}

TEST(Rnn, RemembersAndExposes) {
  const std::vector<std::vector<float>> weights{{2}, {0.5F}, {0.75F}, {3}, {-1}};
  const std::vector<Tensor> inputs{{Shape{1, 1, 1}, {0.25F}}, {Shape{1, 1}, {1}}};
  const double h1 = std::tanh(1.0), h2 = std::tanh(1.0 + 0.75 * h1);
  const auto remembered = run_layer({.type = "RNN",
                                     .param = "recurrent_param { num_output: 1 }",
                                     .inputs = inputs,
                                     .weights = weights,
                                     .passes = 2});
  expect_near(remembered[0].values, {static_cast<float>(std::tanh(3 * h2 - 1))}, 1e-6F);
  std::vector<Tensor> with_state = inputs;
  with_state.push_back({Shape{1, 1, 1}, {static_cast<float>(h1)}});
  const auto exposed = run_layer({.type = "RNN",
                                  .param = "recurrent_param { num_output: 1 expose_hidden: true }",
                                  .inputs = with_state,
                                  .weights = weights,
                                  .n_outputs = 2});
  expect_near(exposed[0].values, remembered[0].values, 1e-6F);
  expect_near(exposed[1].values, {static_cast<float>(h2)}, 1e-6F);
}

TEST(Recurrent, RefusesWhatCannotBe) {
  expect_error<InputError>([] { layer_of("LSTM", ""); }, {"num_output"});
  const auto infer = [](std::vector<Shape> inputs, size_t n_outputs, const std::string& more = "") {
    return [=] {
      layer_of("LSTM", "recurrent_param { num_output: 2 " + more + " }")->infer(inputs, n_outputs);
    };
  };
  expect_error<InputError>(infer({Shape{2, 3, 4}}, 1), {"expected 2 inputs", "found 1"});
  expect_error<InputError>(infer({Shape{2, 3}, Shape{2, 3}}, 1), {"at least 3 axes"});
  expect_error<InputError>(infer({Shape{2, 3, 4}, Shape{3, 2}}, 1), {"2x3", "3x2"});
  expect_error<InputError>(infer({Shape{2, 3, 4}, Shape{2, 3}, Shape{2, 3}}, 1), {"3 streams"});
  expect_error<InputError>(infer({Shape{2, 3, 4}, Shape{2, 3}}, 3), {"outputs"});
  expect_error<InputError>(
      infer({Shape{2, 3, 4}, Shape{2, 3}, Shape{1, 3, 2}, Shape{3, 2}}, 3, "expose_hidden: true"),
      {"state", "1x3x2", "3x2"});
}

}  // namespace
}  // namespace revisit::engine
