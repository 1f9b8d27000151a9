#include <algorithm>

#include "layers/layers.h"
#include "revisit/engine/parallel_for.h"

namespace revisit::engine {
namespace {

constexpr int64_t kChunk = 1024;  // elements per step, which fit the L1 cache

using Inputs = std::vector<const float*>;

void multiply(const Inputs& inputs, int64_t begin, int64_t count, float* result) {
  std::copy_n(inputs[0] + begin, count, result);
  for (size_t k = 1; k < inputs.size(); ++k)
    for (int64_t i = 0; i < count; ++i) result[i] *= inputs[k][begin + i];
}

void add(const Inputs& inputs, const std::vector<float>& coefficients, int64_t begin, int64_t count,
         float* result) {
  std::fill_n(result, count, 0.0F);
  for (size_t k = 0; k < inputs.size(); ++k) {
    const float coefficient = coefficients[k];
    if (coefficient == 0) continue;  // as in BLAS: NaN does not propagate
    for (int64_t i = 0; i < count; ++i) result[i] += coefficient * inputs[k][begin + i];
  }
}

/// Caffe's comparisons: if either of the first two inputs is NaN, the second remains.
void maximum(const Inputs& inputs, int64_t begin, int64_t count, float* result) {
  for (int64_t i = 0; i < count; ++i) {
    const float a = inputs[0][begin + i], b = inputs[1][begin + i];
    result[i] = a > b ? a : b;
  }
  for (size_t k = 2; k < inputs.size(); ++k)
    for (int64_t i = 0; i < count; ++i)
      if (inputs[k][begin + i] > result[i]) result[i] = inputs[k][begin + i];
}

class Eltwise : public Layer {
 public:
  using Param = caffe::EltwiseParameter;

  explicit Eltwise(const Param& param) : param_(param) {
    if (param.operation() == Param::PROD && param.coeff_size() > 0)
      throw InputError("coeff is for the operation SUM, not for PROD");
  }

  std::vector<Shape> infer(const std::vector<Shape>& inputs, size_t n_outputs) const override {
    if (inputs.size() < 2) throw InputError("expected at least 2 inputs, found ", inputs.size());
    expect_count(n_outputs, 1, "outputs");
    const auto n_coefficients = static_cast<size_t>(param_.coeff_size());
    if (n_coefficients != 0 && n_coefficients != inputs.size())
      throw InputError("expected one coeff for each of ", inputs.size(), " inputs, found ",
                       n_coefficients);
    for (const Shape& input : inputs)
      if (input != inputs[0])
        throw InputError("inputs must have the same shape, found ", inputs[0], " and ", input);
    return {inputs[0]};
  }

  OutputMemory output_memory() const override { return OutputMemory::kMayReuseInput; }
  bool keeps_items(size_t, const std::vector<Shape>&) const override { return true; }

  Form form(const std::vector<Shape>& inputs, const std::vector<Tensor>&) const override {
    using Operation = BlockedEltwise::Operation;
    if (param_.operation() == Param::PROD) return Combining{Operation::kProduct, {}};
    if (param_.operation() == Param::MAX) return Combining{Operation::kMaximum, {}};
    return Combining{Operation::kSum, coefficients(inputs.size())};
  }

  /// False for sum and maximum, because Caffe fills their output before it reads the inputs.
  bool allows_in_place() const override { return param_.operation() == Param::PROD; }

  Kernel bind(const Binding& binding) const override {
    const int64_t elements = binding.outputs[0].elements();
    const int threads = binding.threads;
    if (param_.operation() == Param::PROD) return kernel("product", elements, threads, multiply);
    if (param_.operation() == Param::MAX) return kernel("maximum", elements, threads, maximum);
    return kernel("sum", elements, threads,
                  [coefficients = coefficients(binding.inputs.size())](
                      const Inputs& inputs, int64_t begin, int64_t count, float* result) {
                    add(inputs, coefficients, begin, count, result);
                  });
  }

 private:
  std::vector<float> coefficients(size_t n_inputs) const {
    std::vector<float> result(param_.coeff().begin(), param_.coeff().end());
    result.resize(n_inputs, 1);
    return result;
  }

  /// Reads a chunk of all inputs before it writes the output, which may share their memory.
  template <class Combine>
  static Kernel kernel(const char* name, int64_t elements, int threads, Combine combine) {
    return {name, [elements, threads, combine = std::move(combine)](const Call& call) {
              parallel_ranges(elements, kChunk, threads, [&](int64_t begin, int64_t end) {
                float result[kChunk];
                combine(call.inputs, begin, end - begin, result);
                std::copy_n(result, end - begin, call.outputs[0] + begin);
              });
            }};
  }

  Param param_;
};

}  // namespace

std::unique_ptr<Layer> make_eltwise(const caffe::LayerParameter& param) {
  return std::make_unique<Eltwise>(param.eltwise_param());
}

}  // namespace revisit::engine
