#pragma once

#include "kernels/nchw.h"
#include "layer.h"

namespace revisit::engine {

class PoolingWindow {
 public:
  /// Throws InputError for parameters that Caffe rejects, UnsupportedError for stochastic pooling.
  explicit PoolingWindow(const caffe::PoolingParameter& param);

  bool is_max() const { return param_.pool() == caffe::PoolingParameter::MAX; }

  /// Returns the single-threaded problem for an input `[n][c][h][w]`, including the output size.
  /// Throws InputError if the input has other axes or the output would be empty.
  PoolingProblem problem(const Shape& input) const;

  std::optional<WindowHw> window() const;

 private:
  Window axis(uint32_t kernel, uint32_t stride, bool has_stride, uint32_t pad, bool has_pad) const;
  Window global(const Window& axis, int64_t input) const;
  int64_t size(int64_t input, const Window& axis) const;

  caffe::PoolingParameter param_;
  Window h_, w_;
};

}  // namespace revisit::engine
