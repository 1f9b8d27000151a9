#pragma once

#include <cstdint>

namespace revisit::engine {

/// Maximum pooling of regions (Girshick 2015): each `[image, x1, y1, x2, y2]` of `rois`, scaled and
/// rounded to pixels, both ends included, is cut into out_h x out_w bins that can overlap by a
/// pixel. Images are `[n][c][h][w]`, outputs `[rois][c][out_h][out_w]`.
struct RoiPoolingProblem {
  int64_t n = 1, c = 1, h = 1, w = 1;
  int64_t rois = 1, out_h = 1, out_w = 1;
  float scale = 1;
  int threads = 1;
};

/// An empty bin is 0, one of NaN only -FLT_MAX. A region of an image that is not there, where Caffe
/// aborts, or with coordinates that are not finite, becomes NaN.
void roi_pool(const RoiPoolingProblem& problem, const float* input, const float* rois,
              float* output);

}  // namespace revisit::engine
