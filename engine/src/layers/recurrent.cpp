#include <algorithm>

#include "kernels/nchw.h"
#include "layers/layers.h"

namespace revisit::engine {
namespace {

enum class Cell { kLstm, kRnn };

/// LSTM and RNN. Inputs: x `[steps][streams][...]`, cont `[steps][streams]`, optionally a static
/// input `[streams][...]`. With expose_hidden also the hidden state (LSTM: and the cell) before the
/// first step, and further outputs for the state after the last. Otherwise it keeps its state.
class Recurrent : public Layer {
 public:
  Recurrent(const caffe::RecurrentParameter& param, Cell cell)
      : cell_(cell), output_(param.num_output()), expose_(param.expose_hidden()) {
    if (output_ < 1) throw InputError("num_output must be at least 1");
  }

  std::vector<Shape> infer(const std::vector<Shape>& inputs, size_t n_outputs) const override {
    const size_t fewest = 2 + n_exposed();
    if (inputs.size() != fewest && inputs.size() != fewest + 1)
      throw InputError("expected ", fewest, " inputs, or ", fewest + 1,
                       " with a static input, found ", inputs.size());
    expect_count(n_outputs, 1 + n_exposed(), "outputs");
    const Shape &x = inputs[0], &cont = inputs[1];
    if (x.rank() < 3)
      throw InputError("the input needs at least 3 axes (steps x streams x values), found ", x);
    if (cont != Shape{x[0], x[1]})
      throw InputError("the continuation indicators must be ", x[0], "x", x[1],
                       " (steps x streams), found ", cont);
    if (has_static(inputs)) {
      const Shape& fixed = inputs[2];
      if (fixed.rank() < 2 || fixed[0] != x[1])
        throw InputError("the static input must be ", x[1], " streams x values, found ", fixed);
    }
    const Shape state{1, x[1], output_};
    for (size_t i = inputs.size() - n_exposed(); i < inputs.size(); ++i)
      if (inputs[i] != state) throw InputError("the state must be ", state, ", found ", inputs[i]);
    std::vector<Shape> outputs(1 + n_exposed(), state);
    outputs[0] = Shape{x[0], x[1], output_};
    return outputs;
  }

  std::vector<Shape> weight_shapes(const std::vector<Shape>& inputs) const override {
    const RecurrentProblem p = problem(inputs);
    const int64_t width = cell_ == Cell::kLstm ? 4 * output_ : output_;
    std::vector<Shape> shapes{Shape{width, p.input}, Shape{width}};
    if (p.static_input > 0) shapes.push_back(Shape{width, p.static_input});
    shapes.push_back(Shape{width, output_});
    if (cell_ == Cell::kRnn) {
      shapes.push_back(Shape{output_, output_});
      shapes.push_back(Shape{output_});
    }
    return shapes;
  }

  Kernel bind(const Binding& binding) const override {
    RecurrentProblem p = problem(binding.inputs);
    p.threads = binding.threads;
    std::vector<const float*> weights;
    for (const Tensor& tensor : binding.weights) weights.push_back(tensor.values.data());
    if (p.static_input == 0) weights.insert(weights.begin() + 2, nullptr);
    const int64_t floats = p.streams * p.output;
    const bool reference = binding.reference_kernels;
    const auto run = [p, floats, weights, cell = cell_, exposed = n_exposed(),
                      reference](const Call& call) {
      RecurrentOperands o{call.inputs[0],
                          call.inputs[1],
                          p.static_input > 0 ? call.inputs[2] : nullptr,
                          call.outputs[0],
                          {call.state, call.state + floats},
                          call.scratch};
      if (exposed > 0) {
        const size_t first = call.inputs.size() - exposed;
        for (size_t i = 0; i < exposed; ++i)
          std::copy_n(call.inputs[first + i], floats, call.outputs[1 + i]);
        o.state = {call.outputs[1], exposed > 1 ? call.outputs[2] : nullptr};
      }
      if (cell == Cell::kLstm)
        (reference ? lstm_reference : lstm)(p, {weights[0], weights[1], weights[2], weights[3]}, o);
      else
        (reference ? rnn_reference : rnn)(
            p, {weights[0], weights[1], weights[2], weights[3], weights[4], weights[5]}, o);
    };
    int64_t each_step = 0;  // products per stream
    for (const Tensor& tensor : binding.weights)
      if (tensor.shape.rank() == 2) each_step += tensor.shape.elements();
    const int64_t once = p.static_input > 0 ? binding.weights[2].shape.elements() : 0;
    const int64_t macs = p.streams * (p.steps * (each_step - once) + once);
    const int64_t scratch = cell_ == Cell::kLstm ? lstm_scratch_floats(p) : rnn_scratch_floats(p);
    Kernel kernel{reference              ? "reference"
                  : cell_ == Cell::kLstm ? "lstm-gemm"
                                         : "rnn-gemm",
                  run,
                  engine::floats(reference ? 0 : scratch),
                  {.macs = macs, .uses_blas = !reference}};
    kernel.state = engine::floats(expose_ ? 0 : floats * static_cast<int64_t>(n_states()));
    return kernel;
  }

 private:
  size_t n_states() const { return cell_ == Cell::kLstm ? 2 : 1; }
  size_t n_exposed() const { return expose_ ? n_states() : 0; }
  bool has_static(const std::vector<Shape>& inputs) const {
    return inputs.size() > 2 + n_exposed();
  }

  RecurrentProblem problem(const std::vector<Shape>& inputs) const {
    RecurrentProblem p;
    p.steps = inputs[0][0];
    p.streams = inputs[0][1];
    p.input = inputs[0].product(2, inputs[0].rank());
    p.output = output_;
    if (has_static(inputs)) p.static_input = inputs[2].product(1, inputs[2].rank());
    return p;
  }

  Cell cell_;
  int64_t output_;
  bool expose_;
};

/// LSTM of junhyukoh/caffe-lstm, lstm_layer.cpp. Inputs: x and optionally `clip`, which is nonzero
/// for steps that continue a sequence and 0 for those that start one. Without `clip` each pass is
/// one sequence; with it the layer keeps its state. x is `[steps][streams][...]`
/// (tianzhi0549/CTPN); with batch_size or two axes, as in the original, `[steps * streams][...]`.
class RowsLstm : public Layer {
 public:
  explicit RowsLstm(const caffe::LstmParameter& param)
      : param_(param), output_(param.num_output()) {
    if (output_ < 1) throw InputError("num_output must be at least 1");
    if (param.batch_size() < 1) throw InputError("batch_size must be at least 1");
  }

  std::vector<Shape> infer(const std::vector<Shape>& inputs, size_t n_outputs) const override {
    if (inputs.size() != 1 && inputs.size() != 2)
      throw InputError("expected 1 input, or 2 with clip, found ", inputs.size());
    expect_count(n_outputs, 1, "outputs");
    const RecurrentProblem p = problem(inputs[0]);
    if (inputs.size() == 2) {
      const Shape& clip = inputs[1];
      if (clip.rank() < 1 || clip.rank() > 4 || clip[0] != clip.elements() ||
          clip[0] < p.steps + p.streams - 1)
        throw InputError("clip must have at least ", p.steps + p.streams - 1,
                         " values along axis 0 (steps + streams - 1), found ", clip);
    }
    if (is_rows(inputs[0])) return {Shape{inputs[0][0], output_}};
    return {Shape{p.steps, p.streams, output_}};
  }

  std::vector<Shape> weight_shapes(const std::vector<Shape>& inputs) const override {
    return {Shape{4 * output_, problem(inputs[0]).input}, Shape{4 * output_, output_},
            Shape{4 * output_}};
  }

  Kernel bind(const Binding& binding) const override {
    RecurrentProblem p = problem(binding.inputs[0]);
    p.threads = binding.threads;
    const std::vector<Tensor>& w = binding.weights;
    const LstmWeights weights{w[0].values.data(), w[2].values.data(), nullptr, w[1].values.data()};
    const bool remembers = binding.inputs.size() == 2, reference = binding.reference_kernels;
    const int64_t state = 2 * p.streams * p.output, conts = p.steps * p.streams;
    const auto run = [=](const Call& call) {
      float* const begin = remembers ? call.state : call.scratch;
      float* const cont = remembers ? call.scratch : call.scratch + state;
      if (!remembers) std::fill_n(begin, state, 0.0F);
      for (int64_t i = 0; i < conts; ++i) {
        const int64_t t = i / p.streams, n = i % p.streams;
        // Index t + n, not t * streams + n, as in the original, which reads other streams' values.
        cont[i] = (remembers ? call.inputs[1][t + n] != 0 : t > 0) ? 1 : 0;
      }
      (reference ? lstm_reference : lstm)(p, weights,
                                          {call.inputs[0],
                                           cont,
                                           nullptr,
                                           call.outputs[0],
                                           {begin, begin + state / 2},
                                           cont + conts});
    };
    Kernel kernel{
        reference ? "reference" : "lstm-gemm",
        run,
        floats(conts + (remembers ? 0 : state) + (reference ? 0 : lstm_scratch_floats(p))),
        {.macs = conts * 4 * p.output * (p.input + p.output), .uses_blas = !reference}};
    kernel.state = floats(remembers ? state : 0);
    return kernel;
  }

 private:
  bool is_rows(const Shape& x) const { return param_.has_batch_size() || x.rank() == 2; }

  RecurrentProblem problem(const Shape& x) const {
    RecurrentProblem p;
    p.output = output_;
    if (x.rank() < 2) throw InputError("the input needs at least 2 axes, found ", x);
    if (!is_rows(x)) {
      p.steps = x[0];
      p.streams = x[1];
      p.input = x.product(2, x.rank());
      return p;
    }
    p.streams = param_.batch_size();
    if (x[0] % p.streams != 0)
      throw InputError("the ", x[0], " rows of the input (", x,
                       ") are not a multiple of batch_size ", p.streams);
    // The shape distinguishes the layouts by the weights, except in this case.
    if (x.rank() > 2 && x[1] == 1 && p.streams > 1)
      throw InputError(
          "the input (", x, ") has ", p.streams, " streams by batch_size as in ",
          "junhyukoh/caffe-lstm, 1 by its axis 1 as in tianzhi0549/CTPN; reshape it to ",
          "2 axes, or remove batch_size");
    p.steps = x[0] / p.streams;
    p.input = x.product(1, x.rank());
    return p;
  }

  caffe::LstmParameter param_;
  int64_t output_;
};

}  // namespace

constinit const LayerEntries kRecurrentLayers = {
    {"LSTM", make<Recurrent, &Parameters::recurrent_param, Cell::kLstm>, "Caffe",
     "long short-term memory", kTrained},
    {"Lstm", make<RowsLstm, &Parameters::lstm_param>, "CTPN, caffe-lstm",
     "long short-term memory, weights in different order", kTrained},
    {"RNN", make<Recurrent, &Parameters::recurrent_param, Cell::kRnn>, "Caffe",
     "simple recurrent network", kTrained},
};

}  // namespace revisit::engine
