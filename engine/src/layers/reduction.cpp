#include <algorithm>
#include <cmath>
#include <new>
#include <numeric>

#include "kernels/nchw.h"
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

class ArgMax : public OneToOneLayer {
 public:
  explicit ArgMax(const caffe::ArgMaxParameter& param) : param_(param) {
    if (param.top_k() < 1) throw InputError("top_k must be at least 1");
  }

  Shape output_shape(const Shape& input) const override {
    if (input.rank() < 1) throw InputError("ArgMax needs an input of at least one axis");
    const int64_t top_k = param_.top_k(), candidates = lines(input).size;
    if (top_k > candidates)
      throw InputError("top_k ", top_k, " is more than the ", candidates,
                       " values to choose from in an input of shape ", input);
    if (const auto axis = only_axis(input)) return input.with(*axis, top_k);
    // n x (indices, values) x k, and 1 for further axes.
    std::vector<int64_t> axes(std::max<size_t>(input.rank(), 3), 1);
    axes[0] = input[0];
    axes[1] = param_.out_max_val() ? 2 : 1;
    axes[2] = top_k;
    return Shape(std::move(axes));
  }

  std::optional<size_t> only_axis(const Shape& input) const override {
    if (!param_.has_axis()) return std::nullopt;
    return input.canonical_axis(param_.axis(), "argmax axis");
  }

  Kernel bind(const Binding& binding) const override {
    const AxisRuns l = lines(binding.inputs[0]);
    const int64_t top_k = param_.top_k();
    const bool values = param_.out_max_val(), indices = !values || !param_.has_axis();
    return {"partial-sort",
            [l, top_k, values, indices](const Call& call) {
              float* out = call.outputs[0];
              for (int64_t o = 0; o < l.outer; ++o)
                for (int64_t i = 0; i < l.inner; ++i) {
                  const float* line = call.inputs[0] + o * l.size * l.inner + i;
                  const int32_t* best = sort(line, l, top_k, call.scratch);
                  float* place = out + o * top_k * l.inner * (values && indices ? 2 : 1) + i;
                  if (indices)
                    for (int64_t k = 0; k < top_k; ++k, place += l.inner)
                      *place = static_cast<float>(best[k]);
                  if (values)
                    for (int64_t k = 0; k < top_k; ++k, place += l.inner)
                      *place = line[best[k] * l.inner];
                }
            },
            floats(l.size)};
  }

 private:
  AxisRuns lines(const Shape& input) const {
    if (const auto axis = only_axis(input)) return runs_along(input, *axis);
    return {input[0], input.product(1, input.rank()), 1};
  }

  /// Orders like Caffe's algorithm, even with NaN; later indices come first among equal values.
  static const int32_t* sort(const float* line, const AxisRuns& l, int64_t top_k, float* scratch) {
    static_assert(sizeof(int32_t) == sizeof(float));
    auto* order = new (scratch) int32_t[static_cast<size_t>(l.size)];
    std::iota(order, order + l.size, 0);
    std::partial_sort(order, order + top_k, order + l.size, [&](int32_t a, int32_t b) {
      const float x = line[a * l.inner], y = line[b * l.inner];
      return y < x || (!(x < y) && b < a);
    });
    return order;
  }

  caffe::ArgMaxParameter param_;
};

}  // namespace

constinit const LayerEntries kReductionLayers = {
    {"ArgMax", make<ArgMax, &Parameters::argmax_param>, "Caffe",
     "index and value of the largest entries"},
    {"Reduction", make<Reduction, &Parameters::reduction_param>, "Caffe",
     "sum, absolute sum, sum of squares, mean"},
};

}  // namespace revisit::engine
