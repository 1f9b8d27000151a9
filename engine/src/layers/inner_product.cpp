#include <algorithm>

#include "kernels/nchw.h"
#include "layers/layers.h"
#include "weight_cache.h"

namespace revisit::engine {
namespace {

class InnerProduct : public OneToOneLayer {
 public:
  explicit InnerProduct(const caffe::InnerProductParameter& param) : param_(param) {
    if (param.num_output() < 1) throw InputError("num_output must be at least 1");
  }

  Shape output_shape(const Shape& input) const override {
    const size_t axis = first_axis(input);
    std::vector<int64_t> axes(input.axes().begin(),
                              input.axes().begin() + static_cast<int64_t>(axis));
    axes.push_back(param_.num_output());
    return Shape(std::move(axes));
  }

  std::vector<Shape> weight_shapes(const std::vector<Shape>& inputs) const override {
    const int64_t n = param_.num_output(),
                  k = inputs[0].product(first_axis(inputs[0]), inputs[0].rank());
    std::vector<Shape> shapes{param_.transpose() ? Shape{k, n} : Shape{n, k}};
    if (param_.bias_term()) shapes.push_back(Shape{n});
    return shapes;
  }

  Rounding rounding() const override { return Rounding::kAveraged; }

  bool keeps_items(size_t, const std::vector<Shape>& inputs) const override {
    return first_axis(inputs[0]) > 0;
  }

  Kernel bind(const Binding& binding) const override {
    const Shape& input = binding.inputs[0];
    const size_t axis = first_axis(input);
    const InnerProductProblem problem{input.product(0, axis), param_.num_output(),
                                      input.product(axis, input.rank()), param_.transpose(),
                                      binding.threads};
    const float* weights = binding.weights[0].values.data();
    const float* bias = param_.bias_term() ? binding.weights[1].values.data() : nullptr;
    if (binding.bf16_weights && problem.has_few_inputs()) return bind_bf16(problem, bias, binding);
    const InnerProductKernel& kernel =
        binding.reference_kernels ? kInnerProductReference : choose_inner_product(problem);
    return {kernel.name,
            [problem, run = kernel.run, weights, bias](const Call& call) {
              run(problem, call.inputs[0], weights, bias, call.outputs[0]);
            },
            {},
            {.macs = problem.m * problem.n * problem.k, .uses_blas = kernel.uses_blas}};
  }

 private:
  static Kernel bind_bf16(const InnerProductProblem& problem, const float* bias,
                          const Binding& binding) {
    Kernel kernel;
    kernel.name = "gemv bf16";
    kernel.work.macs = problem.m * problem.n * problem.k;
    kernel.packed = floats((problem.n * problem.k + 1) / 2);
    kernel.hold =
        [size = kernel.packed, &weights = binding.weights, cache = binding.cache,
         key = PackedWeightsKey{binding.layer, {}, {}, false, kernel.name, Precision::kBf16}] {
          return cache->get(key, [&] {
            PackedWeights made{AlignedFloats(size.count / floats(1).count), {}};
            std::transform(weights[0].values.begin(), weights[0].values.end(),
                           reinterpret_cast<BFloat16*>(made.weights.data()), to_bfloat16);
            return made;
          });
        };
    kernel.run = [problem, bias](const Call& call) {
      inner_product_bf16(problem, call.inputs[0],
                         reinterpret_cast<const BFloat16*>(call.weights->weights.data()), bias,
                         call.outputs[0]);
    };
    return kernel;
  }

  size_t first_axis(const Shape& input) const {
    return input.canonical_axis(param_.axis(), "inner product axis");
  }

  caffe::InnerProductParameter param_;
};

}  // namespace

constinit const LayerEntries kInnerProductLayers = {
    {"InnerProduct", make<InnerProduct, &Parameters::inner_product_param>, "Caffe",
     "fully connected", kTrained},
};

}  // namespace revisit::engine
