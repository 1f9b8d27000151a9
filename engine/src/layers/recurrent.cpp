#include "kernels/recurrent.h"

#include <algorithm>

#include "layers/layers.h"

namespace revisit::engine {
namespace {

enum class Cell { kLstm, kRnn };

/// LSTM and RNN. Inputs: x `[steps][streams][...]`, cont `[steps][streams]`, perhaps a static input
/// `[streams][...]`, and with expose_hidden the hidden state (LSTM: and the cell) before the first
/// step; those after the last are further outputs. Else the layer itself remembers them.
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
    int64_t each_step = 0;  // products of one stream
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

}  // namespace

std::unique_ptr<Layer> make_lstm(const caffe::LayerParameter& param) {
  return std::make_unique<Recurrent>(param.recurrent_param(), Cell::kLstm);
}

std::unique_ptr<Layer> make_rnn(const caffe::LayerParameter& param) {
  return std::make_unique<Recurrent>(param.recurrent_param(), Cell::kRnn);
}

}  // namespace revisit::engine
