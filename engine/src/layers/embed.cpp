#include <algorithm>
#include <limits>

#include "layers/layers.h"
#include "revisit/engine/parallel_for.h"

namespace revisit::engine {
namespace {

/// Sets the row to NaN for an index out of range, where Caffe reads past the table.
class Embed : public OneToOneLayer {
 public:
  explicit Embed(const caffe::EmbedParameter& param) : param_(param) {
    if (param.num_output() < 1) throw InputError("num_output must be at least 1");
    if (param.input_dim() < 1) throw InputError("input_dim must be at least 1");
  }

  Shape output_shape(const Shape& input) const override {
    std::vector<int64_t> axes = input.axes();
    axes.push_back(param_.num_output());
    return Shape(std::move(axes));
  }

  std::vector<Shape> weight_shapes(const std::vector<Shape>&) const override {
    std::vector<Shape> shapes{Shape{param_.input_dim(), param_.num_output()}};
    if (param_.bias_term()) shapes.push_back(Shape{param_.num_output()});
    return shapes;
  }

  Kernel bind(const Binding& binding) const override {
    const float* table = binding.weights[0].values.data();
    const float* bias = param_.bias_term() ? binding.weights[1].values.data() : nullptr;
    return {"lookup", [indices = binding.inputs[0].elements(), rows = int64_t{param_.input_dim()},
                       size = int64_t{param_.num_output()}, table, bias,
                       threads = binding.threads](const Call& call) {
              const int64_t grain = std::max<int64_t>(kParallelGrain / size, 1);
              parallel_ranges(indices, grain, threads, [&](int64_t begin, int64_t end) {
                for (int64_t i = begin; i < end; ++i) {
                  const float index = call.inputs[0][i];
                  float* out = call.outputs[0] + i * size;
                  // Indices are truncated toward zero, so -0.5 becomes 0.
                  if (!(index > -1 && index < static_cast<float>(rows))) {
                    std::fill_n(out, size, std::numeric_limits<float>::quiet_NaN());
                    continue;
                  }
                  std::copy_n(table + static_cast<int64_t>(index) * size, size, out);
                  if (bias)
                    for (int64_t k = 0; k < size; ++k) out[k] += bias[k];
                }
              });
            }};
  }

 private:
  caffe::EmbedParameter param_;
};

}  // namespace

std::unique_ptr<Layer> make_embed(const caffe::LayerParameter& param) {
  return std::make_unique<Embed>(param.embed_param());
}

}  // namespace revisit::engine
