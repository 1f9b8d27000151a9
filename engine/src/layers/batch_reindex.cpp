#include <algorithm>
#include <limits>

#include "layers/layers.h"
#include "revisit/engine/parallel_for.h"

namespace revisit::engine {
namespace {

/// Sets the image to NaN for an index out of range, where Caffe aborts.
class BatchReindex : public Layer {
 public:
  std::vector<Shape> infer(const std::vector<Shape>& inputs, size_t n_outputs) const override {
    expect_count(inputs.size(), 2, "inputs");
    expect_count(n_outputs, 1, "outputs");
    if (inputs[0].rank() < 1) throw InputError("the first input must have at least one axis");
    if (inputs[1].rank() != 1)
      throw InputError("the indices must have one axis, found ", inputs[1]);
    return {inputs[0].with(0, inputs[1][0])};
  }

  Kernel bind(const Binding& binding) const override {
    const Shape &input = binding.inputs[0], &output = binding.outputs[0];
    return {"copy", [images = input[0], chosen = output[0], size = input.product(1, input.rank()),
                     threads = binding.threads](const Call& call) {
              const int64_t grain = std::max<int64_t>(kParallelGrain / size, 1);
              parallel_ranges(chosen, grain, threads, [&](int64_t begin, int64_t end) {
                for (int64_t i = begin; i < end; ++i) {
                  const float index = call.inputs[1][i];
                  float* out = call.outputs[0] + i * size;
                  if (index >= 0 && index < static_cast<float>(images))
                    std::copy_n(call.inputs[0] + static_cast<int64_t>(index) * size, size, out);
                  else
                    std::fill_n(out, size, std::numeric_limits<float>::quiet_NaN());
                }
              });
            }};
  }
};

}  // namespace

std::unique_ptr<Layer> make_batch_reindex(const caffe::LayerParameter&) {
  return std::make_unique<BatchReindex>();
}

}  // namespace revisit::engine
