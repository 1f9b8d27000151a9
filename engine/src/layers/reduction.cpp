#include <cmath>

#include "layers/layers.h"
#include "revisit/engine/parallel_for.h"

namespace revisit::engine {
namespace {

class Reduction : public OneToOneLayer {
 public:
  explicit Reduction(const caffe::ReductionParameter& param) : param_(param) {}

  Shape output_shape(const Shape& input) const override {
    const std::vector<int64_t>& axes = input.axes();
    return Shape(
        std::vector<int64_t>(axes.begin(), axes.begin() + static_cast<int64_t>(first_axis(input))));
  }

  bool keeps_items(size_t, const std::vector<Shape>& inputs) const override {
    return first_axis(inputs[0]) > 0;
  }

  Kernel bind(const Binding& binding) const override {
    if (param_.operation() == caffe::ReductionParameter::ASUM)
      return kernel(binding, "sum-of-magnitudes", [](double x) { return std::abs(x); });
    if (param_.operation() == caffe::ReductionParameter::SUMSQ)
      return kernel(binding, "sum-of-squares", [](double x) { return x * x; });
    return kernel(binding, "sum", [](double x) { return x; });
  }

 private:
  size_t first_axis(const Shape& input) const {
    return input.canonical_axis(param_.axis(), "reduction axis");
  }

  /// Sums in double, so that the order of summation has no visible effect.
  template <class Term>
  Kernel kernel(const Binding& binding, const char* name, Term term) const {
    const Shape& input = binding.inputs[0];
    const size_t axis = first_axis(input);
    const int64_t rows = input.product(0, axis), size = input.product(axis, input.rank());
    const bool mean = param_.operation() == caffe::ReductionParameter::MEAN;
    const float factor = mean ? param_.coeff() / static_cast<float>(size) : param_.coeff();
    return {name, [rows, size, factor, term, threads = binding.threads](const Call& call) {
              const int64_t grain = std::max<int64_t>(kParallelGrain / size, 1);
              parallel_ranges(rows, grain, threads, [&](int64_t begin, int64_t end) {
                for (int64_t row = begin; row < end; ++row) {
                  const float* in = call.inputs[0] + row * size;
                  double sum = 0;
                  for (int64_t i = 0; i < size; ++i) sum += term(in[i]);
                  call.outputs[0][row] = static_cast<float>(sum) * factor;
                }
              });
            }};
  }

  caffe::ReductionParameter param_;
};

}  // namespace

std::unique_ptr<Layer> make_reduction(const caffe::LayerParameter& param) {
  return std::make_unique<Reduction>(param.reduction_param());
}

}  // namespace revisit::engine
