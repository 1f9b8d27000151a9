#include <algorithm>

#include "layers/layers.h"

namespace revisit::engine {
namespace {

void one_or_each(int given, size_t n_outputs, const char* name) {
  if (given != 1 && static_cast<size_t>(given) != n_outputs)
    throw InputError(name, " is given ", given, " times; expected once, or once for each of ",
                     n_outputs, " outputs");
}

template <class Field>
const auto& entry_for(const Field& field, size_t i) {
  return field.Get(field.size() == 1 ? 0 : static_cast<int>(i));
}

/// Rejects random fillers, whose results depend on Caffe's generator and seed.
class DummyData : public Layer {
 public:
  explicit DummyData(const caffe::DummyDataParameter& param) : param_(param) {
    for (const caffe::FillerParameter& filler : param.data_filler()) {
      if (filler.type() != "constant")
        throw UnsupportedError("filler '", filler.type(),
                               "' is not supported (only 'constant' is deterministic)");
      if (filler.sparse() != -1) throw InputError("the filler 'constant' does not take sparse");
    }
  }

  std::vector<Shape> infer(const std::vector<Shape>& inputs, size_t n_outputs) const override {
    expect_count(inputs.size(), 0, "inputs");
    expect_any(n_outputs, "output");
    if (param_.data_filler_size() > 0)
      one_or_each(param_.data_filler_size(), n_outputs, "data_filler");
    const bool legacy = param_.num_size() > 0 || param_.channels_size() > 0 ||
                        param_.height_size() > 0 || param_.width_size() > 0;
    std::vector<Shape> outputs;
    if (legacy) {
      if (param_.shape_size() > 0)
        throw InputError("give shape, or num, channels, height and width, not both");
      one_or_each(param_.num_size(), n_outputs, "num");
      one_or_each(param_.channels_size(), n_outputs, "channels");
      one_or_each(param_.height_size(), n_outputs, "height");
      one_or_each(param_.width_size(), n_outputs, "width");
      for (size_t i = 0; i < n_outputs; ++i)
        outputs.push_back(Shape{entry_for(param_.num(), i), entry_for(param_.channels(), i),
                                entry_for(param_.height(), i), entry_for(param_.width(), i)});
    } else {
      one_or_each(param_.shape_size(), n_outputs, "shape");
      for (size_t i = 0; i < n_outputs; ++i) {
        const auto& dims = entry_for(param_.shape(), i).dim();
        outputs.push_back(Shape(std::vector<int64_t>(dims.begin(), dims.end())));
      }
    }
    return outputs;
  }

  Kernel bind(const Binding& binding) const override {
    struct Fill {
      int64_t elements;
      float value;
    };
    std::vector<Fill> fills;
    for (size_t i = 0; i < binding.outputs.size(); ++i)
      fills.push_back(
          {binding.outputs[i].elements(),
           param_.data_filler_size() == 0 ? 0 : entry_for(param_.data_filler(), i).value()});
    return {"fill", [fills = std::move(fills)](const Call& call) {
              for (size_t i = 0; i < fills.size(); ++i)
                std::fill_n(call.outputs[i], fills[i].elements, fills[i].value);
            }};
  }

 private:
  caffe::DummyDataParameter param_;
};

class Parameter : public Layer {
 public:
  explicit Parameter(const caffe::ParameterParameter& param)
      : shape_(std::vector<int64_t>(param.shape().dim().begin(), param.shape().dim().end())) {}

  std::vector<Shape> infer(const std::vector<Shape>& inputs, size_t n_outputs) const override {
    expect_count(inputs.size(), 0, "inputs");
    expect_count(n_outputs, 1, "outputs");
    return {shape_};
  }

  std::vector<Shape> weight_shapes(const std::vector<Shape>&) const override { return {shape_}; }

  Kernel bind(const Binding& binding) const override {
    return {"copy", [values = binding.weights[0].values.data(), elements = shape_.elements()](
                        const Call& call) { std::copy_n(values, elements, call.outputs[0]); }};
  }

 private:
  Shape shape_;
};

}  // namespace

constinit const LayerEntries kDummyDataLayers = {
    {"DummyData", make<DummyData, &Parameters::dummy_data_param>, "Caffe", "constants"},
    {"Parameter", make<Parameter, &Parameters::parameter_param>, "Caffe", "a trained blob",
     kTrained},
};

}  // namespace revisit::engine
