#include "layers/pooling_window.h"

#include <cmath>

namespace revisit::engine {

PoolingWindow::PoolingWindow(const caffe::PoolingParameter& param) : param_(param) {
  // With kernel_size, one of kernel_h and kernel_w alone is ignored.
  const bool has_hw = param.has_kernel_h() && param.has_kernel_w();
  if (param.global_pooling()) {
    if (param.has_kernel_size() || param.has_kernel_h() || param.has_kernel_w())
      throw InputError("global pooling takes no kernel size");
  } else if (param.has_kernel_size() == has_hw) {
    throw InputError("give kernel_size, or both kernel_h and kernel_w (and not both forms)");
  }
  if (param.has_pad() && (param.has_pad_h() || param.has_pad_w()))
    throw InputError("give pad, or pad_h and pad_w, not both");
  if (param.has_pad_h() != param.has_pad_w())
    throw InputError("pad_h and pad_w must be given together");
  if (param.has_stride() && (param.has_stride_h() || param.has_stride_w()))
    throw InputError("give stride, or stride_h and stride_w, not both");
  if (param.has_stride_h() != param.has_stride_w())
    throw InputError("stride_h and stride_w must be given together");
  if (param.has_ceil_mode() && param.has_round_mode())
    throw InputError("give round_mode or ceil_mode, not both");
  if (param.pool() == caffe::PoolingParameter::STOCHASTIC)
    throw UnsupportedError("stochastic pooling is not supported (Caffe runs it on a GPU only)");
  h_ = axis(param.kernel_h(), param.stride_h(), param.has_stride_h(), param.pad_h(),
            param.has_pad_h());
  w_ = axis(param.kernel_w(), param.stride_w(), param.has_stride_w(), param.pad_w(),
            param.has_pad_w());
}

PoolingProblem PoolingWindow::problem(const Shape& input) const {
  expect_image(input, "pooling");
  const Axis h = global(h_, input[2]), w = global(w_, input[3]);
  PoolingProblem p;
  p.planes = input[0] * input[1];
  p.h = input[2], p.w = input[3];
  p.out_h = size(p.h, h), p.out_w = size(p.w, w);
  p.kernel_h = h.kernel, p.kernel_w = w.kernel;
  p.stride_h = h.stride, p.stride_w = w.stride;
  p.pad_h = h.pad, p.pad_w = w.pad;
  return p;
}

std::optional<WindowHw> PoolingWindow::window() const {
  if (param_.global_pooling()) return std::nullopt;
  return WindowHw{{h_.kernel, h_.stride, h_.pad}, {w_.kernel, w_.stride, w_.pad}};
}

PoolingWindow::Axis PoolingWindow::axis(uint32_t kernel, uint32_t stride, bool has_stride,
                                        uint32_t pad, bool has_pad) const {
  const Axis result{param_.has_kernel_size() ? param_.kernel_size() : kernel,
                    has_stride ? stride : param_.stride(), has_pad ? pad : param_.pad()};
  if (param_.global_pooling()) {
    if (result.stride != 1 || result.pad != 0)
      throw InputError("global pooling needs stride 1 and no pad");
    return result;
  }
  expect_int(result.kernel, "the kernel size");
  expect_int(result.stride, "the stride");
  if (result.kernel < 1) throw InputError("the kernel size must be at least 1");
  if (result.stride < 1) throw InputError("the stride must be at least 1");
  if (result.pad >= result.kernel)
    throw InputError("pad ", result.pad, " must be smaller than the kernel ", result.kernel);
  return result;
}

PoolingWindow::Axis PoolingWindow::global(const Axis& axis, int64_t input) const {
  return param_.global_pooling() ? Axis{input, 1, 0} : axis;
}

/// docs/LAYERS.md point 1. Computed in float, like in Caffe.
int64_t PoolingWindow::size(int64_t input, const Axis& axis) const {
  const bool floor = param_.has_ceil_mode() ? !param_.ceil_mode()
                                            : param_.round_mode() == caffe::PoolingParameter::FLOOR;
  const float steps =
      static_cast<float>(input + 2 * axis.pad - axis.kernel) / static_cast<float>(axis.stride);
  int64_t out = static_cast<int64_t>(floor ? std::floor(steps) : std::ceil(steps)) + 1;
  // The last window must start inside the image or its leading pad, once any axis is padded.
  if ((h_.pad || w_.pad) && (out - 1) * axis.stride >= input + axis.pad) --out;
  if (out < 1)
    throw InputError("a kernel of ", axis.kernel, " does not fit into ", input, " + 2 x ", axis.pad,
                     ": the output would be empty");
  return out;
}

}  // namespace revisit::engine
