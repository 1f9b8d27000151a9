#include "kernels/pooling.h"

#include <cmath>

#include "layers/layers.h"

namespace revisit::engine {
namespace {

/// Parameters of one axis.
struct Axis {
  int64_t kernel, stride, pad;
};

class Pooling : public Layer {
 public:
  explicit Pooling(const caffe::PoolingParameter& param) : param_(param) {
    const bool has_hw = param.has_kernel_h() || param.has_kernel_w();
    if (param.global_pooling()) {
      if (param.has_kernel_size() || has_hw)
        throw InputError("global pooling takes no kernel size");
    } else {
      if (param.has_kernel_size() == has_hw)
        throw InputError("give kernel_size, or both kernel_h and kernel_w (and not both forms)");
      if (has_hw && !(param.has_kernel_h() && param.has_kernel_w()))
        throw InputError("kernel_h and kernel_w must be given together");
    }
    if (param.has_pad() && (param.has_pad_h() || param.has_pad_w()))
      throw InputError("give pad, or pad_h and pad_w, not both");
    if (param.has_pad_h() != param.has_pad_w())
      throw InputError("pad_h and pad_w must be given together");
    if (param.has_stride() && (param.has_stride_h() || param.has_stride_w()))
      throw InputError("give stride, or stride_h and stride_w, not both");
    if (param.has_stride_h() != param.has_stride_w())
      throw InputError("stride_h and stride_w must be given together");
    if (param.pool() == caffe::PoolingParameter::STOCHASTIC)
      throw UnsupportedError("stochastic pooling is not supported (Caffe runs it on a GPU only)");
    h_ = axis(param.kernel_h(), param.stride_h(), param.has_stride_h(), param.pad_h(),
              param.has_pad_h());
    w_ = axis(param.kernel_w(), param.stride_w(), param.has_stride_w(), param.pad_w(),
              param.has_pad_w());
  }

  std::vector<Shape> infer(const std::vector<Shape>& inputs, size_t n_outputs) const override {
    expect_count(inputs.size(), 1, "inputs");
    const bool max = param_.pool() == caffe::PoolingParameter::MAX;
    if (n_outputs < 1 || n_outputs > (max ? 2 : 1))
      throw InputError(str("expected ",
                           max ? "1 or 2 outputs (the second is the mask)" : "1 output", ", found ",
                           n_outputs));
    const Shape& input = inputs[0];
    if (input.rank() != 4)
      throw InputError(str("pooling needs an input of 4 axes (n x c x h x w), found ", input));
    const Shape output{input[0], input[1], size(input[2], global(h_, input[2])),
                       size(input[3], global(w_, input[3]))};
    return std::vector<Shape>(n_outputs, output);
  }

  std::optional<WindowHw> window(const Shape&) const override {
    if (param_.global_pooling()) return std::nullopt;
    return WindowHw{{h_.kernel, h_.stride, h_.pad}, {w_.kernel, w_.stride, w_.pad}};
  }

  Kernel bind(const Binding& binding) const override {
    const Shape &input = binding.inputs[0], &output = binding.outputs[0];
    const Axis h = global(h_, input[2]), w = global(w_, input[3]);
    const PoolingProblem problem{input[0] * input[1],
                                 input[2],
                                 input[3],
                                 output[2],
                                 output[3],
                                 h.kernel,
                                 w.kernel,
                                 h.stride,
                                 w.stride,
                                 h.pad,
                                 w.pad,
                                 binding.threads};
    if (param_.pool() == caffe::PoolingParameter::AVE)
      return {"average-pool", [problem](const Call& call) {
                average_pool(problem, call.inputs[0], call.outputs[0]);
              }};
    return {"max-pool", [problem](const Call& call) {
              max_pool(problem, call.inputs[0], call.outputs[0],
                       call.outputs.size() > 1 ? call.outputs[1] : nullptr);
            }};
  }

 private:
  Axis axis(uint32_t kernel, uint32_t stride, bool has_stride, uint32_t pad, bool has_pad) const {
    const Axis result{param_.has_kernel_size() ? param_.kernel_size() : kernel,
                      has_stride ? stride : param_.stride(), has_pad ? pad : param_.pad()};
    if (param_.global_pooling()) {
      if (result.stride != 1 || result.pad != 0)
        throw InputError("global pooling needs stride 1 and no pad");
      return result;
    }
    if (result.kernel < 1) throw InputError("the kernel size must be at least 1");
    if (result.stride < 1) throw InputError("the stride must be at least 1");
    if (result.pad >= result.kernel)
      throw InputError(str("pad ", result.pad, " must be smaller than the kernel ", result.kernel));
    return result;
  }

  Axis global(const Axis& axis, int64_t input) const {
    return param_.global_pooling() ? Axis{input, 1, 0} : axis;
  }

  /// SEMANTICS section 1. Computed in float as the original does.
  int64_t size(int64_t input, const Axis& axis) const {
    const float steps =
        static_cast<float>(input + 2 * axis.pad - axis.kernel) / static_cast<float>(axis.stride);
    int64_t out = static_cast<int64_t>(param_.round_mode() == caffe::PoolingParameter::FLOOR
                                           ? std::floor(steps)
                                           : std::ceil(steps)) +
                  1;
    // The last window must start inside the image or its leading pad. One axis padded is enough for
    // Caffe to check both.
    if ((h_.pad || w_.pad) && (out - 1) * axis.stride >= input + axis.pad) --out;
    if (out < 1)
      throw InputError(str("a kernel of ", axis.kernel, " does not fit into ", input, " + 2 x ",
                           axis.pad, ": the output would be empty"));
    return out;
  }

  caffe::PoolingParameter param_;
  Axis h_{}, w_{};
};

}  // namespace

std::unique_ptr<Layer> make_pooling(const caffe::LayerParameter& param) {
  return std::make_unique<Pooling>(param.pooling_param());
}

}  // namespace revisit::engine
