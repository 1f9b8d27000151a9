#include "layers/layers.h"
#include "layers/pooling_window.h"

namespace revisit::engine {
namespace {

class Pooling : public Layer {
 public:
  explicit Pooling(const caffe::PoolingParameter& param) : window_(param) {}

  std::vector<Shape> infer(const std::vector<Shape>& inputs, size_t n_outputs) const override {
    expect_count(inputs.size(), 1, "inputs");
    const bool max = window_.is_max();
    if (n_outputs < 1 || n_outputs > (max ? 2 : 1))
      throw InputError("expected ", max ? "1 or 2 outputs (the second is the mask)" : "1 output",
                       ", found ", n_outputs);
    const PoolingProblem p = window_.problem(inputs[0]);
    return std::vector<Shape>(n_outputs, Shape{inputs[0][0], inputs[0][1], p.out_h, p.out_w});
  }

  std::optional<WindowHw> window(const Shape&) const override { return window_.window(); }

  Rounding rounding() const override {
    return window_.is_max() ? Rounding::kNone : Rounding::kAveraged;
  }

  Form form(const std::vector<Shape>& inputs, const std::vector<Tensor>&) const override {
    const PoolingProblem problem = window_.problem(inputs[0]);
    return window_.is_max() ? Form(problem) : Form(Averaging{problem});
  }

  Kernel bind(const Binding& binding) const override {
    PoolingProblem problem = window_.problem(binding.inputs[0]);
    problem.threads = binding.threads;
    if (!window_.is_max())
      return {"average-pool", [problem](const Call& call) {
                average_pool(problem, call.inputs[0], call.outputs[0]);
              }};
    return {"max-pool", [problem](const Call& call) {
              max_pool(problem, call.inputs[0], call.outputs[0],
                       call.outputs.size() > 1 ? call.outputs[1] : nullptr);
            }};
  }

 private:
  PoolingWindow window_;
};

}  // namespace

std::unique_ptr<Layer> make_pooling(const caffe::LayerParameter& param) {
  return std::make_unique<Pooling>(param.pooling_param());
}

}  // namespace revisit::engine
