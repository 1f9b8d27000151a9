#include <algorithm>
#include <limits>

#include "layers/layers.h"
#include "revisit/engine/parallel_for.h"

namespace revisit::engine {
namespace {

/// Sets each of `count` rows of `out` to the row of `table` with its index, or to NaN for an index
/// out of range, and adds `bias`, if not null. `truncates`: indices are truncated toward zero, so
/// -0.5 becomes 0.
void take_rows(const float* indices, int64_t count, const float* table, int64_t n_rows,
               int64_t size, const float* bias, bool truncates, int threads, float* out) {
  const int64_t grain = std::max<int64_t>(kParallelGrain / size, 1);
  parallel_ranges(count, grain, threads, [&](int64_t begin, int64_t end) {
    for (int64_t i = begin; i < end; ++i) {
      const float index = indices[i];
      float* const row = out + i * size;
      if ((truncates ? index > -1 : index >= 0) && index < static_cast<float>(n_rows))
        std::copy_n(table + static_cast<int64_t>(index) * size, size, row);
      else
        std::fill_n(row, size, std::numeric_limits<float>::quiet_NaN());
      for (int64_t k = 0; bias && k < size; ++k) row[k] += bias[k];
    }
  });
}

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
              take_rows(call.inputs[0], indices, table, rows, size, bias, true, threads,
                        call.outputs[0]);
            }};
  }

 private:
  caffe::EmbedParameter param_;
};

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
              take_rows(call.inputs[1], chosen, call.inputs[0], images, size, nullptr, false,
                        threads, call.outputs[0]);
            }};
  }
};

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

constinit const LayerEntries kRowsLayers = {
    {"BatchReindex", make<BatchReindex>, "Caffe", "selects and repeats batch items"},
    {"Embed", make<Embed, &Parameters::embed_param>, "Caffe", "rows of a table by index", kTrained},
    {"Filter", make<Filter>, "Caffe", "batch items selected by another blob"},
};

}  // namespace revisit::engine
