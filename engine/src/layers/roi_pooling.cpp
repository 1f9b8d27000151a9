#include <algorithm>
#include <cmath>
#include <limits>

#include "kernels/nchw.h"
#include "layers/layers.h"
#include "revisit/engine/parallel_for.h"

namespace revisit::engine {
namespace {

/// Pooling of regions: each `[image, x1, y1, x2, y2]` of `rois`, scaled, is split into out_h x
/// out_w bins that may overlap by a pixel. Images are `[n][channels][h][w]`, outputs
/// `[rois][c][out_h][out_w]`.
struct RoiPoolingProblem {
  int64_t n = 1, channels = 1, h = 1, w = 1;
  int64_t rois = 1, c = 1, out_h = 1, out_w = 1;
  float scale = 1, pad_ratio = 0;
  int threads = 1;
  Precision values = Precision::kFloat32;  // determines empty_maximum()
};

/// Converts to integer; NaN becomes a limit. Limits prevent overflow and are far outside any image.
int64_t whole(float coordinate) {
  constexpr float kFar = 1e9F;
  return static_cast<int64_t>(std::max(-kFar, std::min(coordinate, kFar)));
}

bool is_valid(const RoiPoolingProblem& p, const float* roi) {
  return std::all_of(roi, roi + 5, [](float v) { return std::isfinite(v); }) && roi[0] > -1 &&
         roi[0] < static_cast<float>(p.n);
}

/// Calls `pool` for valid regions, with output channels [first, last): few enough to share the
/// work, many enough to amortize finding bins. Other regions become NaN: with an image out of
/// range, where Caffe aborts, or with coordinates that are not finite.
template <class Pool>
void for_each_region(const RoiPoolingProblem& p, const float* input, const float* rois,
                     float* output, const Pool& pool) {
  constexpr int64_t kChannels = 32;
  const int64_t parts = (p.c + kChannels - 1) / kChannels, bins = p.out_h * p.out_w;
  parallel_for(p.rois * parts, p.threads, [&](int64_t item, int) {
    const float* roi = rois + item / parts * 5;
    float* out = output + item / parts * p.c * bins;
    const int64_t first = item % parts * kChannels, last = std::min(first + kChannels, p.c);
    if (is_valid(p, roi))
      pool(roi, input + static_cast<int64_t>(roi[0]) * p.channels * p.h * p.w, out, first, last);
    else
      std::fill(out + first * bins, out + last * bins, std::numeric_limits<float>::quiet_NaN());
  });
}

/// Extent of a region along one axis [pixels].
struct Span {
  int64_t start, size;
};

/// Span of a region, ends inclusive, extended by `pad_ratio` of its size at each end
/// (zhaoweicai/mscnn, roi_pooling_layer.cpp). Halves round away from zero.
Span span(float first, float last, const RoiPoolingProblem& p) {
  const float pad = p.pad_ratio == 0 ? 0 : (last - first + 1) * p.pad_ratio;
  const int64_t start = whole(std::round((first - pad) * p.scale)),
                end = whole(std::round((last + pad) * p.scale));
  return {start, std::max<int64_t>(end - start + 1, 1)};
}

WindowRange bin(const Span& region, int64_t i, int64_t n, int64_t image) {
  const float size = static_cast<float>(region.size) / static_cast<float>(n);
  const auto begin = static_cast<int64_t>(std::floor(static_cast<float>(i) * size));
  const auto end = static_cast<int64_t>(std::ceil(static_cast<float>(i + 1) * size));
  return {begin + region.start, end - begin, image};
}

/// Maxima (Girshick 2015). An empty bin is 0; a bin with only NaN is empty_maximum().
void roi_pool(const RoiPoolingProblem& p, const float* input, const float* rois, float* output) {
  for_each_region(
      p, input, rois, output,
      [&](const float* roi, const float* image, float* out, int64_t first, int64_t last) {
        const Span x = span(roi[1], roi[3], p), y = span(roi[2], roi[4], p);
        const int64_t bins = p.out_h * p.out_w;
        for (int64_t i = 0; i < bins; ++i) {
          const WindowRange rows = bin(y, i / p.out_w, p.out_h, p.h),
                            columns = bin(x, i % p.out_w, p.out_w, p.w);
          const bool empty = rows.end <= rows.begin || columns.end <= columns.begin;
          for (int64_t c = first; c < last; ++c) {
            const float* map = image + c * p.h * p.w;
            float best = empty ? 0 : empty_maximum(p.values);
            for (int64_t iy = rows.begin; iy < rows.end; ++iy)
              for (int64_t ix = columns.begin; ix < columns.end; ++ix)
                if (map[iy * p.w + ix] > best) best = map[iy * p.w + ix];
            out[c * bins + i] = best;
          }
        }
      });
}

/// Returns bin `i` of `n` of a region from `first` to `last`. Bins have fractional bounds and
/// include all pixels that they touch (daijifeng001/caffe-rfcn, psroi_pooling_layer.cu). Regions
/// grow by `pad_ratio` of their size at each end (xujinchang/py-R-FCN-multiGPU).
WindowRange bin_of_parts(float first, float last, const RoiPoolingProblem& p, int64_t i, int64_t n,
                         int64_t image) {
  const float pad = p.pad_ratio == 0 ? 0 : (last - first + 1) * p.pad_ratio;
  const float start = std::round(first - pad) * p.scale,
              end = (std::round(last + pad) + 1) * p.scale;
  const float size = std::max(end - start, 0.1F) / static_cast<float>(n);
  const int64_t begin = whole(std::floor(static_cast<float>(i) * size + start));
  return {begin, whole(std::ceil(static_cast<float>(i + 1) * size + start)) - begin, image};
}

/// Returns whether a bin and an object have a pixel in common along an axis (alenaliu/PPR-FCN,
/// psroi_context_pooling_layer.cu).
bool is_shared(const WindowRange& bin, float first, float last, float scale, int64_t image) {
  const auto in_image = [&](float at) { return std::clamp<int64_t>(whole(at), 0, image); };
  return bin.begin < in_image(std::ceil((std::round(last) + 1) * scale)) &&
         bin.end > in_image(std::floor(std::round(first) * scale));
}

/// Averages each bin in its own channel of `[c][out_h][out_w]` (Dai et al. 2016); 0 if empty, or
/// beside the `object` if it is not null: [image, x1, y1, x2, y2], whose image is ignored.
void psroi_pool(const RoiPoolingProblem& p, const float* input, const float* rois,
                const float* object, float* output) {
  for_each_region(
      p, input, rois, output,
      [&](const float* roi, const float* image, float* out, int64_t first, int64_t last) {
        const int64_t bins = p.out_h * p.out_w;
        for (int64_t i = 0; i < bins; ++i) {
          const WindowRange rows = bin_of_parts(roi[2], roi[4], p, i / p.out_w, p.out_h, p.h),
                            columns = bin_of_parts(roi[1], roi[3], p, i % p.out_w, p.out_w, p.w);
          const int64_t n_rows = rows.end - rows.begin, n_columns = columns.end - columns.begin;
          const bool empty = n_rows <= 0 || n_columns <= 0 ||
                             (object && !(is_shared(rows, object[2], object[4], p.scale, p.h) &&
                                          is_shared(columns, object[1], object[3], p.scale, p.w)));
          for (int64_t c = first; c < last; ++c) {
            const float* map = image + (c * bins + i) * p.h * p.w;
            float sum = 0;
            for (int64_t iy = rows.begin; iy < rows.end; ++iy)
              for (int64_t ix = columns.begin; ix < columns.end; ++ix) sum += map[iy * p.w + ix];
            out[c * bins + i] = empty ? 0 : sum / static_cast<float>(n_rows * n_columns);
          }
        }
      });
}

/// Start of a region along one axis and the distance of its sample points [pixels].
struct PointLine {
  float start, step;
};

PointLine point_line(float first, float last, const RoiPoolingProblem& p, int64_t points) {
  const float pad = (last - first + 1) * p.pad_ratio;
  const float start = (first - pad) * p.scale - 0.5F, end = (last + pad) * p.scale - 0.5F;
  return {start, (end - start) / static_cast<float>(points - 1)};
}

/// The pixels next to a point, and the weight of the second.
struct PixelPair {
  int64_t low, high;
  float share;
};

PixelPair pixels_beside(float point, int64_t size) {
  const auto low = static_cast<int64_t>(std::floor(point));
  const int64_t last = size - 1, first = std::clamp<int64_t>(low, 0, last);
  return {first, std::clamp<int64_t>(low + 1, 0, last),
          std::clamp(point, 0.0F, static_cast<float>(last)) - static_cast<float>(first)};
}

/// Bilinear values at the corners of bins (zhaoweicai/mscnn and cascade-rcnn, roi_align_layer.cpp):
/// pooled_h + 1 rows of pooled_w + 1. Points outside the map and empty regions are 0.
void roi_align(const RoiPoolingProblem& p, const float* input, const float* rois, float* output) {
  const auto is_inside = [](float point, int64_t size) {
    return point >= -0.5F && point <= static_cast<float>(size) - 0.5F;
  };
  for_each_region(
      p, input, rois, output,
      [&](const float* roi, const float* image, float* out, int64_t first, int64_t last) {
        const PointLine x = point_line(roi[1], roi[3], p, p.out_w),
                        y = point_line(roi[2], roi[4], p, p.out_h);
        const int64_t points = p.out_h * p.out_w;
        for (int64_t i = 0; i < points; ++i) {
          const int64_t row = i / p.out_w, column = i % p.out_w;
          const float py = y.start + static_cast<float>(row) * y.step,
                      px = x.start + static_cast<float>(column) * x.step;
          const bool counts = x.step > 0 && y.step > 0 && is_inside(py, p.h) && is_inside(px, p.w);
          const PixelPair rows = pixels_beside(counts ? py : 0, p.h),
                          columns = pixels_beside(counts ? px : 0, p.w);
          const float upper = 1 - rows.share, left = 1 - columns.share;
          for (int64_t c = first; c < last; ++c) {
            const float* map = image + c * p.h * p.w;
            const float *low = map + rows.low * p.w, *high = map + rows.high * p.w;
            out[c * points + i] = counts ? left * upper * low[columns.low] +
                                               columns.share * upper * low[columns.high] +
                                               left * rows.share * high[columns.low] +
                                               columns.share * rows.share * high[columns.high]
                                         : 0;
          }
        }
      });
}

class RegionLayer : public Layer {
 public:
  bool keeps_items(size_t port, const std::vector<Shape>&) const override { return port == 1; }

 protected:
  static void check(const std::vector<Shape>& inputs, size_t n_outputs, bool has_object = false) {
    if (has_object)
      expect_count(inputs.size(), 3, "inputs (the feature map, the regions and the objects)");
    else
      expect_count(inputs.size(), 2, "inputs (the feature map and the regions)");
    expect_count(n_outputs, 1, "outputs");
    if (inputs[0].rank() != 4)
      throw InputError("expected a feature map of 4 axes (n x c x h x w), found ", inputs[0]);
    for (size_t i = 1; i < inputs.size(); ++i)
      if (inputs[i].rank() < 1 || inputs[i].product(1, inputs[i].rank()) != 5)
        throw InputError("expected regions of 5 numbers (image, x1, y1, x2, y2), found an input ",
                         "of shape ", inputs[i]);
    if (has_object && inputs[2].elements() < 1) throw InputError("expected an object, found none");
  }

  template <class Param>
  static void check_finite(const Param& param) {
    if (!std::isfinite(param.spatial_scale())) throw InputError("spatial_scale must be finite");
    if (!std::isfinite(param.pad_ratio())) throw InputError("pad_ratio must be finite");
  }

  template <class Param>
  static RoiPoolingProblem problem(const Binding& binding, const Param& param) {
    const Shape &input = binding.inputs[0], &output = binding.outputs[0];
    RoiPoolingProblem p{input[0],  input[1],  input[2],  input[3],
                        output[0], output[1], output[2], output[3]};
    p.scale = param.spatial_scale(), p.pad_ratio = param.pad_ratio();
    p.threads = binding.threads;
    p.values = binding.precision;
    return p;
  }
};

class RoiPooling : public RegionLayer {
 public:
  RoiPooling(const caffe::ROIPoolingParameter& param, bool aligned)
      : param_(param), aligned_(aligned) {
    if (param.pooled_h() < 1 || param.pooled_w() < 1)
      throw InputError("pooled_h and pooled_w must be at least 1");
    check_finite(param);
  }

  std::vector<Shape> infer(const std::vector<Shape>& inputs, size_t n_outputs) const override {
    check(inputs, n_outputs);
    const int64_t more = aligned_ ? 1 : 0;
    return {Shape{inputs[1][0], inputs[0][1], param_.pooled_h() + more, param_.pooled_w() + more}};
  }

  Kernel bind(const Binding& binding) const override {
    const RoiPoolingProblem p = problem(binding, param_);
    const auto pool = aligned_ ? roi_align : roi_pool;
    return {aligned_ ? "roi-align" : "roi-max-pool", [p, pool](const Call& call) {
              pool(p, call.inputs[0], call.inputs[1], call.outputs[0]);
            }};
  }

 private:
  caffe::ROIPoolingParameter param_;
  bool aligned_;
};

class PsRoiPooling : public RegionLayer {
 public:
  PsRoiPooling(const caffe::PSROIPoolingParameter& param, bool has_object)
      : param_(param), has_object_(has_object) {
    if (!param.has_spatial_scale() || !param.has_output_dim() || !param.has_group_size())
      throw InputError("spatial_scale, output_dim and group_size must be given");
    if (param.output_dim() < 1 || param.group_size() < 1)
      throw InputError("output_dim and group_size must be at least 1");
    check_finite(param);
    expect_int(int64_t{param.group_size()} * param.group_size(), "the square of group_size");
  }

  std::vector<Shape> infer(const std::vector<Shape>& inputs, size_t n_outputs) const override {
    check(inputs, n_outputs, has_object_);
    const int64_t dim = param_.output_dim(), group = param_.group_size();
    if (inputs[0][1] != dim * (group * group))
      throw InputError("expected output_dim x group_size x group_size = ", dim * (group * group),
                       " channels, found a feature map of shape ", inputs[0]);
    return {Shape{inputs[1][0], dim, group, group}};
  }

  Kernel bind(const Binding& binding) const override {
    const RoiPoolingProblem p = problem(binding, param_);
    return {"psroi-average-pool", [p, has_object = has_object_](const Call& call) {
              psroi_pool(p, call.inputs[0], call.inputs[1], has_object ? call.inputs[2] : nullptr,
                         call.outputs[0]);
            }};
  }

 private:
  caffe::PSROIPoolingParameter param_;
  bool has_object_;
};

}  // namespace

constinit const LayerEntries kRoiPoolingLayers = {
    {"PSROIContextPooling", make<PsRoiPooling, &Parameters::psroi_context_pooling_param, true>,
     "PPR-FCN", "PSROIPooling whose bins are 0 beside an object", !kTrained,
     "as in alenaliu/PPR-FCN, where the first object serves all regions"},
    {"PSROIPooling", make<PsRoiPooling, &Parameters::psroi_pooling_param, false>, "R-FCN",
     "position-sensitive average of each bin of regions"},
    {"ROIAlign", make<RoiPooling, &Parameters::roi_pooling_param, true>, "Cascade R-CNN",
     "bilinear values at corners of bins of regions", !kTrained,
     "as in MS-CNN and Cascade R-CNN; the ROIAlign of makefile/frcnn has the same fields, "
     "but computes differently"},
    {"ROIPooling", make<RoiPooling, &Parameters::roi_pooling_param, false>, "Fast R-CNN",
     "maximum over regions of interest"},
};

}  // namespace revisit::engine
