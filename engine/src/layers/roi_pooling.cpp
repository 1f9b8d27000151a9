#include <algorithm>
#include <cmath>
#include <limits>

#include "kernels/pooling.h"
#include "layers/layers.h"
#include "revisit/engine/parallel_for.h"

namespace revisit::engine {
namespace {

/// Maximum pooling of regions (Girshick 2015): each `[image, x1, y1, x2, y2]` of `rois`, scaled and
/// rounded to pixels, both ends included, is cut into out_h x out_w bins that can overlap by a
/// pixel. Images are `[n][c][h][w]`, outputs `[rois][c][out_h][out_w]`.
struct RoiPoolingProblem {
  int64_t n = 1, c = 1, h = 1, w = 1;
  int64_t rois = 1, out_h = 1, out_w = 1;
  float scale = 1;
  int threads = 1;
  Precision values = Precision::kFloat32;  // decides the empty_maximum()
};

/// A region along one axis [pixels].
struct Span {
  int64_t start, size;
};

/// Halves round away from zero. Limits keep the arithmetic in range and are far outside any image.
int64_t to_pixel(float coordinate, float scale) {
  constexpr float kFar = 1e9F;
  return static_cast<int64_t>(std::round(std::clamp(coordinate * scale, -kFar, kFar)));
}

Span span(float first, float last, float scale) {
  const int64_t start = to_pixel(first, scale), end = to_pixel(last, scale);
  return {start, std::max<int64_t>(end - start + 1, 1)};
}

/// Bin `i` of `n`.
WindowRange bin(const Span& region, int64_t i, int64_t n, int64_t image) {
  const float size = static_cast<float>(region.size) / static_cast<float>(n);
  const auto begin = static_cast<int64_t>(std::floor(static_cast<float>(i) * size));
  const auto end = static_cast<int64_t>(std::ceil(static_cast<float>(i + 1) * size));
  return {begin + region.start, end - begin, image};
}

bool is_valid(const RoiPoolingProblem& p, const float* roi) {
  return std::all_of(roi, roi + 5, [](float v) { return std::isfinite(v); }) && roi[0] > -1 &&
         roi[0] < static_cast<float>(p.n);
}

/// An empty bin is 0, one of NaN only the empty_maximum(). A region of an image that is not there,
/// where Caffe aborts, or with coordinates that are not finite, becomes NaN.
void roi_pool(const RoiPoolingProblem& p, const float* input, const float* rois, float* output) {
  parallel_for(p.rois * p.c, p.threads, [&](int64_t item, int) {
    const float* roi = rois + item / p.c * 5;
    float* out = output + item * p.out_h * p.out_w;
    if (!is_valid(p, roi)) {
      std::fill_n(out, p.out_h * p.out_w, std::numeric_limits<float>::quiet_NaN());
      return;
    }
    const float* image = input + (static_cast<int64_t>(roi[0]) * p.c + item % p.c) * p.h * p.w;
    const Span x = span(roi[1], roi[3], p.scale), y = span(roi[2], roi[4], p.scale);
    for (int64_t i = 0; i < p.out_h; ++i)
      for (int64_t j = 0; j < p.out_w; ++j) {
        const WindowRange rows = bin(y, i, p.out_h, p.h), columns = bin(x, j, p.out_w, p.w);
        const bool empty = rows.end <= rows.begin || columns.end <= columns.begin;
        float best = empty ? 0 : empty_maximum(p.values);
        for (int64_t iy = rows.begin; iy < rows.end; ++iy)
          for (int64_t ix = columns.begin; ix < columns.end; ++ix)
            if (image[iy * p.w + ix] > best) best = image[iy * p.w + ix];
        *out++ = best;
      }
  });
}

class RoiPooling : public Layer {
 public:
  explicit RoiPooling(const caffe::ROIPoolingParameter& param) : param_(param) {
    if (param.pooled_h() < 1 || param.pooled_w() < 1)
      throw InputError("pooled_h and pooled_w must be at least 1");
    if (!std::isfinite(param.spatial_scale())) throw InputError("spatial_scale must be finite");
  }

  std::vector<Shape> infer(const std::vector<Shape>& inputs, size_t n_outputs) const override {
    expect_count(inputs.size(), 2, "inputs (the feature map and the regions)");
    expect_count(n_outputs, 1, "outputs");
    const Shape &input = inputs[0], &rois = inputs[1];
    if (input.rank() != 4)
      throw InputError("expected a feature map of 4 axes (n x c x h x w), found ", input);
    if (rois.rank() < 1 || rois.product(1, rois.rank()) != 5)
      throw InputError(
          "expected regions of 5 numbers (image, x1, y1, x2, y2), found an input of shape ", rois);
    return {Shape{rois[0], input[1], param_.pooled_h(), param_.pooled_w()}};
  }

  Kernel bind(const Binding& binding) const override {
    const Shape& input = binding.inputs[0];
    RoiPoolingProblem p{input[0], input[1], input[2], input[3], binding.inputs[1][0]};
    p.out_h = param_.pooled_h(), p.out_w = param_.pooled_w();
    p.scale = param_.spatial_scale();
    p.threads = binding.threads;
    p.values = binding.precision;
    return {"roi-max-pool", [p](const Call& call) {
              roi_pool(p, call.inputs[0], call.inputs[1], call.outputs[0]);
            }};
  }

 private:
  caffe::ROIPoolingParameter param_;
};

}  // namespace

std::unique_ptr<Layer> make_roi_pooling(const caffe::LayerParameter& param) {
  return std::make_unique<RoiPooling>(param.roi_pooling_param());
}

}  // namespace revisit::engine
