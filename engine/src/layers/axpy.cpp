#include <algorithm>

#include "kernels/channel_runs.h"
#include "layers/layers.h"

namespace revisit::engine {
namespace {

class Axpy : public Layer {
 public:
  std::vector<Shape> infer(const std::vector<Shape>& inputs, size_t n_outputs) const override {
    expect_count(inputs.size(), 3, "inputs");
    expect_count(n_outputs, 1, "outputs");
    const Shape &a = inputs[0], &x = inputs[1], &y = inputs[2];
    if (x != y) throw InputError("x and y must have the same shape, found ", x, " and ", y);
    if (x.rank() < 2 || a.rank() < 2 || a[0] != x[0] || a[1] != x[1] || a.elements() != x[0] * x[1])
      throw InputError("expected a factor for each image and channel of x (", x,
                       "), that is n x c or n x c x 1 x 1, found ", a);
    return {x};
  }

  std::optional<WindowHw> window(const Shape&) const override { return WindowHw{}; }

  Form form(const std::vector<Shape>&, const std::vector<Tensor>&) const override {
    return Gating{.x = 1, .factors = 0, .addend = 2, .zero_hides = true};
  }

  Kernel bind(const Binding& binding) const override {
    const Shape& x = binding.inputs[1];
    const ChannelRuns runs{1, x[0] * x[1], x.product(2, x.rank())};
    return {"axpy", [runs, threads = binding.threads](const Call& call) {
              const float *x_data = call.inputs[1], *y_data = call.inputs[2];
              float* out = call.outputs[0];
              for_each_run(runs, threads, [&](int64_t channel, int64_t begin, int64_t end) {
                const float a = call.inputs[0][channel];
                if (a == 0)  // as in BLAS: NaN in x does not propagate
                  std::copy(y_data + begin, y_data + end, out + begin);
                else
                  for (int64_t i = begin; i < end; ++i) out[i] = a * x_data[i] + y_data[i];
              });
            }};
  }
};

}  // namespace

std::unique_ptr<Layer> make_axpy(const caffe::LayerParameter&) {
  return std::make_unique<Axpy>();
}

}  // namespace revisit::engine
