#pragma once

#include "kernels/nchw.h"
#include "kernels/window.h"
#include "layer.h"
#include "layers/pad_ends.h"

namespace revisit::engine {

class PoolingWindow {
 public:
  /// Throws InputError for parameters that Caffe rejects, UnsupportedError for stochastic pooling.
  explicit PoolingWindow(const caffe::PoolingParameter& param);

  bool is_max() const { return param_.pool() == caffe::PoolingParameter::MAX; }

  /// Windows along the spatial axes of an input `[n][c][h][w]` or `[n][c][depth][h][w]`. Throws
  /// InputError if the input has other axes or the output would be empty.
  WindowAxes axes(const Shape& input) const;

  /// Returns the single-threaded problem for an input. Throws as axes().
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
  std::optional<std::array<int64_t, 2>> ends_;  // pad_ends()
};

}  // namespace revisit::engine
