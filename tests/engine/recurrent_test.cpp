#include "simd_targets.h"
#include "single_layer.h"
#include "testing.h"

namespace revisit::engine {
namespace {

/// Five steps of three streams of random numbers; stream 1 is halved at step 4.
SingleLayer random_lstm(int64_t fixed, int64_t output, const std::string& more = "") {
  SingleLayer l{"LSTM", str("recurrent_param { num_output: ", output, " ", more, " }"), {}};
  l.inputs = {{Shape{5, 3, 2, 2}, random_floats(5 * 3 * 4, 1)},
              {Shape{5, 3}, {0, 1, 1, 1, 1, 0, 1, 0, 1, 1, 1, 1, 1, 0.5F, 1}}};
  l.weights = {random_floats(4 * output * 4, 3), random_floats(4 * output, 4)};
  if (fixed > 0) {
    l.inputs.push_back({Shape{3, fixed}, random_floats(3 * fixed, 2)});
    l.weights.push_back(random_floats(4 * output * fixed, 5));
  }
  l.weights.push_back(random_floats(4 * output * output, 6));
  return l;
}

void expect_as_slow_twin(SingleLayer layer, float tolerance = 1e-6F) {
  const std::vector<Tensor> found = run_layer(layer);
  layer.reference = true;
  const std::vector<Tensor> wanted = run_layer(layer);
  for (size_t i = 0; i < wanted.size(); ++i) {
    SCOPED_TRACE(i);
    EXPECT_EQ(found[i].shape, wanted[i].shape);
    expect_near(found[i].values, wanted[i].values, tolerance);
  }
}

TEST(Lstm, ByHand) {
  // One step, one unit, no memory: c = sigmoid(i) tanh(g), h = sigmoid(o) tanh(c).
  for (const bool reference : {false, true}) {
    const auto found = run_layer({.type = "LSTM",
                                  .param = "recurrent_param { num_output: 1 }",
                                  .inputs = {{Shape{1, 1, 1}, {2}}, {Shape{1, 1}, {0}}},
                                  .weights = {{1, 5, -1, 0.5F}, {0, 0, 1, 0}, {9, 9, 9, 9}},
                                  .reference = reference});
    EXPECT_EQ(found[0].shape, (Shape{1, 1, 1}));
    const double c = sigmoid(2) * std::tanh(1);
    expect_near(found[0].values, {static_cast<float>(sigmoid(-1) * std::tanh(c))}, 1e-7F);
  }
}

TEST(Lstm, SecondStepByHand) {
  // Weights of x: i 1, f 5, o -1, g 0.5; of h: i 2, f 0, o 1, g -1. The second stream restarts.
  for (const bool reference : {false, true}) {
    const auto found =
        run_layer({.type = "LSTM",
                   .param = "recurrent_param { num_output: 1 }",
                   .inputs = {{Shape{2, 2, 1}, {2, 2, 1, 1}}, {Shape{2, 2}, {0, 0, 1, 0}}},
                   .weights = {{1, 5, -1, 0.5F}, {0, 0, 1, 0}, {2, 0, 1, -1}},
                   .reference = reference});
    const double c1 = sigmoid(2) * std::tanh(1), h1 = sigmoid(-1) * std::tanh(c1);
    const double c2 = sigmoid(5) * c1 + sigmoid(1 + 2 * h1) * std::tanh(0.5 - h1);
    const double h2 = sigmoid(h1) * std::tanh(c2);
    const double anew = sigmoid(0) * std::tanh(sigmoid(1) * std::tanh(0.5));
    expect_near(found[0].values,
                {static_cast<float>(h1), static_cast<float>(h1), static_cast<float>(h2),
                 static_cast<float>(anew)},
                1e-7F);
  }
}

TEST(Lstm, StaticInputAndExposedStateByHand) {
  // Gates i 4.5, f 3.5, o -0.5, g -0.25: each has another weight of x, static input, h and bias.
  for (const bool reference : {false, true}) {
    const auto found =
        run_layer({.type = "LSTM",
                   .param = "recurrent_param { num_output: 1 expose_hidden: true }",
                   .inputs = {{Shape{1, 1, 1}, {2}},
                              {Shape{1, 1}, {1}},
                              {Shape{1, 1}, {3}},
                              {Shape{1, 1, 1}, {0.5F}},
                              {Shape{1, 1, 1}, {-0.25F}}},
                   .weights = {{1, 0, -1, 0.5F}, {0, 0, 1, 0}, {0.5F, 1, 0, -0.25F}, {2, 1, 1, -1}},
                   .n_outputs = 3,
                   .reference = reference});
    const double c = sigmoid(3.5) * -0.25 + sigmoid(4.5) * std::tanh(-0.25);
    const auto h = static_cast<float>(sigmoid(-0.5) * std::tanh(c));
    expect_near(found[0].values, {h}, 1e-6F);
    expect_near(found[1].values, {h}, 1e-6F);
    expect_near(found[2].values, {static_cast<float>(c)}, 1e-6F);
  }
}

TEST(Lstm, FollowsTheEquationsAndRemembersBetweenPasses) {
  for (const int passes : {1, 2, 3}) {
    SingleLayer layer = random_lstm(0, 2);
    layer.threads = layer.passes = passes;
    expect_as_slow_twin(layer);
  }
}

TEST(Lstm, UnitsThatDoAndDoNotFillAVector) {
  for (const int64_t units : {1, 15, 16, 37})
    test::for_each_simd_target([&] { expect_as_slow_twin(random_lstm(0, units)); });
}

TEST(Lstm, StaticInputAndExposedState) {
  SingleLayer layer = random_lstm(3, 2, "expose_hidden: true");
  layer.inputs.push_back({Shape{1, 3, 2}, random_floats(6, 7)});
  layer.inputs.push_back({Shape{1, 3, 2}, random_floats(6, 8)});
  layer.n_outputs = 3;
  expect_as_slow_twin(layer);
  const std::vector<Tensor> once = run_layer(layer);
  layer.passes = 2;  // the layer keeps no state, because it is an input
  EXPECT_EQ(run_layer(layer)[0].values, once[0].values);
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

/// The layer of Lstm.SecondStepByHand as caffe-lstm has it: weights of x, of h, bias.
SingleLayer rows_lstm(std::vector<Tensor> inputs, const std::string& more = "") {
  return {"Lstm",
          "lstm_param { num_output: 1 clipping_threshold: 0.01 " + more + " }",
          std::move(inputs),
          {{1, 5, -1, 0.5F}, {2, 0, 1, -1}, {0, 0, 1, 0}}};
}

/// h after steps of x = 2, 1, 1, by hand.
std::vector<float> three_steps() {
  const double c1 = sigmoid(2) * std::tanh(1), h1 = sigmoid(-1) * std::tanh(c1);
  const double c2 = sigmoid(5) * c1 + sigmoid(1 + 2 * h1) * std::tanh(0.5 - h1);
  const double h2 = sigmoid(h1) * std::tanh(c2);
  const double c3 = sigmoid(5) * c2 + sigmoid(1 + 2 * h2) * std::tanh(0.5 - h2);
  const double h3 = sigmoid(h2) * std::tanh(c3);
  return {static_cast<float>(h1), static_cast<float>(h2), static_cast<float>(h3)};
}

TEST(RowsLstm, APassIsASequence) {
  const std::vector<float> h = three_steps();
  for (const bool reference : {false, true})
    for (const int passes : {1, 2}) {
      SingleLayer layer = rows_lstm({{Shape{3, 1, 1, 1}, {2, 1, 1}}});
      layer.reference = reference;
      layer.passes = passes;
      const Tensor found = run_layer(layer)[0];
      EXPECT_EQ(found.shape, (Shape{3, 1, 1}));
      expect_near(found.values, h, 1e-6F);
    }
}

TEST(RowsLstm, RowsOfSeveralStreams) {
  const std::vector<float> h = three_steps();
  const Tensor one = run_layer(rows_lstm({{Shape{3, 1}, {2, 1, 1}}}))[0];
  EXPECT_EQ(one.shape, (Shape{3, 1}));
  expect_near(one.values, h, 1e-6F);
  const Tensor two = run_layer(rows_lstm({{Shape{4, 1}, {2, 2, 1, 1}}}, "batch_size: 2"))[0];
  EXPECT_EQ(two.shape, (Shape{4, 1}));
  expect_near(two.values, {h[0], h[0], h[1], h[1]}, 1e-6F);
}

TEST(RowsLstm, ClipContinuesSequencesFromPassToPass) {
  const std::vector<float> h = three_steps();
  for (const float yes : {1.0F, 0.5F, kNan}) {  // any nonzero value; Caffe's LSTM multiplies by it
    SingleLayer layer = rows_lstm({{Shape{3, 1}, {2, 1, 1}}, {Shape{3, 1}, {0, yes, yes}}});
    layer.passes = 2;
    expect_near(run_layer(layer)[0].values, h, 1e-6F);
    // Steps of 2, then of 1 and of 1: one sequence, of which the second pass has the end.
    Tensor x{Shape{1, 1}, {1}};
    SingleLayer rest = rows_lstm({x, {Shape{1}, {yes}}});
    std::vector<float> found;
    for (const int passes : {1, 2, 3}) {
      rest.passes = passes;
      found.push_back(run_layer(rest)[0].values[0]);
    }
    const SingleLayer whole = rows_lstm({{Shape{3, 1}, {1, 1, 1}}});
    expect_near(found, run_layer(whole)[0].values, 1e-6F);
  }
}

/// clip[t + n] is for step t and stream n, where clip[t * streams + n] was intended.
TEST(RowsLstm, IsLstmWithWeightsInAnotherOrder) {
  for (const int64_t units : {3, 16}) {
    SingleLayer lstm = random_lstm(0, units);
    lstm.inputs[1].values = {0, 1, 1, 1, 1, 0, 1, 0, 1, 0, 1, 0, 1, 0, 0};
    const auto& w = lstm.weights;
    const SingleLayer rows{"Lstm",
                           str("lstm_param { num_output: ", units, " }"),
                           {lstm.inputs[0], {Shape{7}, {0, 1, 1, 0, 1, 0, 0}}},
                           {w[0], w[2], w[1]}};
    for (const bool reference : {false, true})
      for (const int threads : {1, 3}) {
        SingleLayer a = lstm, b = rows;
        a.reference = b.reference = reference;
        a.threads = b.threads = threads;
        a.passes = b.passes = 2;
        EXPECT_EQ(run_layer(a)[0].values, run_layer(b)[0].values);
      }
  }
}

TEST(RowsLstm, IsNotTakenForCaffesLstm) {
  expect_error<UnsupportedError>([] { layer_of("lstm", ""); }, {"did you mean 'Lstm'?"});
  expect_error<UnsupportedError>([] { layer_of("LSTm", ""); }, {"did you mean 'LSTM'?"});
}

TEST(RowsLstm, RejectsInvalidParameters) {
  expect_error<InputError>([] { layer_of("Lstm", ""); }, {"num_output"});
  const auto infer = [](std::vector<Shape> inputs, const std::string& more = "", size_t n = 1) {
    return [=] { layer_of("Lstm", "lstm_param { num_output: 2 " + more + " }")->infer(inputs, n); };
  };
  expect_error<InputError>(infer({Shape{2, 3}}, "batch_size: 0"), {"batch_size"});
  expect_error<InputError>(infer({}), {"expected 1 input", "found 0"});
  expect_error<InputError>(infer({Shape{2, 3}}, "", 2), {"outputs"});
  expect_error<InputError>(infer({Shape{2}}), {"at least 2 axes", "found 2"});
  expect_error<InputError>(infer({Shape{5, 3}}, "batch_size: 2"), {"5 rows", "batch_size 2"});
  expect_error<InputError>(infer({Shape{4, 1, 3}}, "batch_size: 2"), {"2 streams", "4x1x3"});
  expect_error<InputError>(infer({Shape{4, 3, 5}, Shape{5}}), {"at least 6 values", "found 5"});
  expect_error<InputError>(infer({Shape{4, 3, 5}, Shape{4, 3}}), {"axis 0", "found 4x3"});
  infer({Shape{4, 3, 5}, Shape{12, 1, 1, 1}})();
}

TEST(Rnn, ByHand) {
  // h1 = tanh(2 x1), h2 = tanh(2 x2 + 0.5 h1 + 1 * static), o = tanh(3 h - 1); cont cuts at t = 1.
  SingleLayer layer{
      "RNN",
      "recurrent_param { num_output: 1 }",
      {{Shape{2, 1, 1}, {0.25F, -0.5F}}, {Shape{2, 1}, {0, 1}}, {Shape{1, 1}, {0.125F}}},
      {{2}, {0.5F}, {4}, {0.75F}, {3}, {-1}}};
  const double h1 = std::tanh(0.5 + 0.5 + 0.5), h2 = std::tanh(-1.0 + 0.5 + 0.5 + 0.75 * h1);
  const std::vector<float> wanted{static_cast<float>(std::tanh(3 * h1 - 1)),
                                  static_cast<float>(std::tanh(3 * h2 - 1))};
  expect_near(run_layer(layer)[0].values, wanted, 1e-6F);
  layer.reference = true;
  expect_near(run_layer(layer)[0].values, wanted, 1e-7F);
}

TEST(Rnn, IsItsReference) {
  SingleLayer layer{"RNN",
                    "recurrent_param { num_output: 19 }",
                    {{Shape{4, 3, 5}, random_floats(4 * 3 * 5, 1)},
                     {Shape{4, 3}, {0, 1, 1, 1, 1, 0, 1, 0.5F, 1, 1, 1, 1}},
                     {Shape{3, 2}, random_floats(3 * 2, 2)}},
                    {random_floats(19 * 5, 3), random_floats(19, 4), random_floats(19 * 2, 5),
                     random_floats(19 * 19, 6), random_floats(19 * 19, 7), random_floats(19, 8)}};
  layer.passes = 2;
  // Sums of 26 products, whose rounding errors grow over eight steps.
  test::for_each_simd_target([&] { expect_as_slow_twin(layer, 5e-6F); });
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

TEST(Recurrent, RejectsInvalidParameters) {
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

TEST(ContinuationIndicator, IsZeroAtTheFirstStep) {
  const std::string param = "continuation_indicator_param { time_step: 3 batch_size: 2 }";
  const auto found = run_layer({"ContinuationIndicator", param, {}});
  EXPECT_EQ(found[0].shape, (Shape{3, 2}));
  EXPECT_EQ(found[0].values, (std::vector<float>{0, 0, 1, 1, 1, 1}));
  expect_rejected("ContinuationIndicator", "continuation_indicator_param { time_step: 3 }", {},
                  {"batch_size must be given"});
  const std::string axis =
      "continuation_indicator_param { time_step: 2 axis: -1 }";  // jolibrain/caffe
  const auto by_axis =
      run_layer({"ContinuationIndicator", axis, {{Shape{4, 3}, std::vector<float>(12)}}});
  EXPECT_EQ(by_axis[0].shape, (Shape{2, 3}));
  EXPECT_EQ(by_axis[0].values, (std::vector<float>{0, 0, 0, 1, 1, 1}));
  expect_rejected("ContinuationIndicator", param, {Shape{4, 3}}, {"inputs"});
}

/// Two sequences of 4 steps and 3 classes; the second ends after 2.
TEST(CtcGreedyDecoder, ByHand) {
  test::SingleLayer l{"CTCGreedyDecoder",
                      "",
                      {{Shape{4, 2, 3}, {.1F, .8F, .1F, .9F, .1F, 0, .1F, .7F, .2F, 0, .4F, .6F,
                                         .1F, 0,   .9F, 1,   0,   0, 0,   1,   0,   1, 0,   0}},
                       {Shape{4, 2}, {0, 0, 1, 1, 1, 0, 1, 1}}}};
  l.n_outputs = 2;
  const auto found = run_layer(l);
  EXPECT_EQ(found[0].shape, (Shape{4, 2, 1, 1}));
  EXPECT_EQ(found[0].values, (std::vector<float>{1, 0, 1, -1, -1, -1, -1, -1}));
  expect_near(found[1].values, {-3.4F, -1.5F}, 1e-6F);
  l.n_outputs = 1;
  l.param = "ctc_decoder_param { blank_index: 0 ctc_merge_repeated: false }";
  EXPECT_EQ(run_layer(l)[0].values, (std::vector<float>{1, 2, 1, -1, 2, -1, 1, -1}));
  l.inputs.pop_back();
  EXPECT_EQ(run_layer(l)[0].values, (std::vector<float>{1, 2, 1, -1, 2, -1, 1, -1}));
  expect_rejected("CTCGreedyDecoder", "ctc_decoder_param { blank_index: 3 }", {Shape{4, 2, 3}},
                  {"blank_index 3", "3 classes"});
  expect_rejected("CTCGreedyDecoder", "", {Shape{4, 2}}, {"steps x sequences x classes"});
  expect_rejected("CTCGreedyDecoder", "", {Shape{4, 2, 3}, Shape{3, 2}}, {"4 x 2"});
}

}  // namespace
}  // namespace revisit::engine
