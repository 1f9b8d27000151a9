#pragma once

#include "kernels/nchw.h"
#include "kernels/window.h"
#include "layer.h"

namespace revisit::engine {

/// Returns whether pad_b and pad_r give trailing pads other than pad_h and pad_w, the leading ones.
/// Throws InputError for pad_l, pad_r, pad_t, pad_b that the upgrade left because of another pad.
template <class Param>
bool expect_pad_ends(const Param& param) {
  const bool has_ends = param.has_pad_b() && param.has_pad_r();
  if (param.has_pad_l() || param.has_pad_t() || param.has_pad_b() != param.has_pad_r() ||
      (has_ends && !(param.has_pad_h() && param.has_pad_w())))
    throw InputError("give pad, or pad_h and pad_w, or pad_l, pad_r, pad_t and pad_b");
  return has_ends;
}

class PoolingWindow {
 public:
  /// Throws InputError for parameters that Caffe rejects, UnsupportedError for stochastic pooling.
  explicit PoolingWindow(const caffe::PoolingParameter& param);

  bool is_max() const { return param_.pool() == caffe::PoolingParameter::MAX; }
  bool counts_padding() const { return param_.pool() != caffe::PoolingParameter::AVE_EXC_PAD; }

  /// Windows along the spatial axes of an input `[n][c][h][w]` or `[n][c][depth][h][w]`. Throws
  /// InputError if the input has other axes or the output would be empty.
  WindowAxes axes(const Shape& input) const;

  /// Returns the single-threaded problem for an input `[n][c][h][w]`. Throws as axes().
  PoolingProblem problem(const Shape& input) const;

  /// Windows along the last two axes; nullopt if global.
  std::optional<WindowHw> window(const Shape& input) const;

 private:
  bool is_nd() const {
    return param_.kernel_size_nd_size() + param_.stride_nd_size() + param_.pad_nd_size() > 0;
  }
  /// `checked`: throws InputError unless fields per axis are given for all `n_axes`.
  Window window(size_t axis, size_t n_axes, bool checked) const;
  int64_t size(const WindowAxis& axis, bool is_padded) const;

  caffe::PoolingParameter param_;
};

}  // namespace revisit::engine
