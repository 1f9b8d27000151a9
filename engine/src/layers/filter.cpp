#include <algorithm>

#include "layers/layers.h"

namespace revisit::engine {
namespace {

/// Counts NaN in the selector as nonzero.
class Filter : public Layer {
 public:
  std::vector<Shape> infer(const std::vector<Shape>& inputs, size_t n_outputs) const override {
    if (inputs.size() < 2)
      throw InputError("expected at least 2 inputs: what to filter, and last the selector");
    expect_count(n_outputs, inputs.size() - 1, "outputs");
    const Shape& selector = inputs.back();
    if (selector.rank() < 1 || selector.elements() != selector[0])
      throw InputError("the selector must hold one number for each item, found ", selector);
    for (const Shape& input : inputs)
      if (input.rank() < 1 || input[0] != selector[0])
        throw InputError("the selector is for ", selector[0], " items (", selector,
                         "), found an input of shape ", input);
    return {inputs.begin(), inputs.end() - 1};
  }

  std::optional<size_t> dynamic_axis() const override { return 0; }

  Kernel bind(const Binding& binding) const override {
    std::vector<int64_t> sizes;  // floats per item, for each input to filter
    for (size_t i = 0; i + 1 < binding.inputs.size(); ++i)
      sizes.push_back(binding.inputs[i].product(1, binding.inputs[i].rank()));
    return {"copy-selected", [sizes, items = binding.inputs[0][0]](const Call& call) {
              const float* selector = call.inputs.back();
              *call.rows = 0;
              for (int64_t item = 0; item < items; ++item) {
                if (selector[item] == 0) continue;
                for (size_t i = 0; i < sizes.size(); ++i)
                  std::copy_n(call.inputs[i] + item * sizes[i], sizes[i],
                              call.outputs[i] + *call.rows * sizes[i]);
                ++*call.rows;
              }
            }};
  }
};

}  // namespace

std::unique_ptr<Layer> make_filter(const caffe::LayerParameter&) {
  return std::make_unique<Filter>();
}

}  // namespace revisit::engine
