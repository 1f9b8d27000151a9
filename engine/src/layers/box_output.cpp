#include <algorithm>
#include <array>
#include <cfloat>
#include <cmath>

#include "caffe_schema.pb.h"
#include "kernels/detection.h"
#include "layers/layers.h"
#include "revisit/base/error.h"

namespace revisit::engine {
namespace {

/// Mean and deviation of a box's four offsets (bbox_reg_param of MS-CNN).
class BoxOffsets {
 public:
  BoxOffsets() = default;
  /// Uses means and deviations only if both are given.
  explicit BoxOffsets(const caffe::BBoxRegParameter& param) {
    if (param.bbox_mean_size() == 0 || param.bbox_std_size() == 0) return;
    if (param.bbox_mean_size() != 4 || param.bbox_std_size() != 4)
      throw InputError("expected 4 bbox_mean and 4 bbox_std, found ", param.bbox_mean_size(),
                       " and ", param.bbox_std_size());
    std::ranges::copy(param.bbox_mean(), means_.begin());
    std::ranges::copy(param.bbox_std(), deviations_.begin());
    for (const float deviation : deviations_)
      if (!(deviation > 0)) throw InputError("bbox_std must be above 0, found ", deviation);
  }

  float apply(size_t i, float number) const { return number * deviations_[i] + means_[i]; }

 private:
  std::array<float, 4> means_{0, 0, 0, 0}, deviations_{1, 1, 1, 1};
};

/// Regions for the next stage of Cascade R-CNN (zhaoweicai/cascade-rcnn,
/// src/caffe/layers/decode_bbox_layer.cpp): regions `[rows][image, x1, y1, x2, y2]` moved by the
/// offsets of the foreground, the second half of `[rows][8]`. Regions include both ends.
void decode_regions(const BoxOffsets& offsets, int64_t rows, const float* numbers,
                    const float* regions, float* output) {
  for (int64_t i = 0; i < rows; ++i, numbers += 8, regions += 5, output += 5) {
    const float w = regions[3] - regions[1] + 1, h = regions[4] - regions[2] + 1;
    const auto t = [&](size_t k) { return offsets.apply(k, numbers[4 + k]); };
    const float new_w = w * std::exp(t(2)), new_h = h * std::exp(t(3));
    const float x = t(0) * w + 0.5F * (regions[3] + regions[1]) - (new_w - 1) / 2;
    const float y = t(1) * h + 0.5F * (regions[4] + regions[2]) - (new_h - 1) / 2;
    const float row[] = {regions[0], x, y, x + new_w - 1, y + new_h - 1};
    std::copy(std::begin(row), std::end(row), output);
  }
}

class DecodeBBox : public Layer {
 public:
  explicit DecodeBBox(const caffe::LayerParameter& param) : offsets_(param.bbox_reg_param()) {
    if (is_for_training(param))
      throw UnsupportedError(
          "`phase: TRAIN` on a DecodeBBox layer drops regions by the ground truth: remove it");
  }

  std::vector<Shape> infer(const std::vector<Shape>& inputs, size_t n_outputs) const override {
    expect_count(inputs.size(), 2, "inputs (offsets and regions; a third is for training)");
    expect_count(n_outputs, 1, "outputs");
    const Shape &offsets = inputs[0], &regions = inputs[1];
    const auto is_rows_of = [](const Shape& shape, int64_t numbers) {
      return shape.rank() >= 2 && shape[1] == numbers && shape.product(2, shape.rank()) == 1;
    };
    if (!is_rows_of(offsets, 8) || !is_rows_of(regions, 5) || offsets[0] != regions[0])
      throw InputError(
          "expected 8 offsets and 5 numbers (image, x1, y1, x2, y2) for each region, found ",
          offsets, " and ", regions);
    return {Shape{regions[0], 5, 1, 1}};
  }

  bool keeps_items(size_t, const std::vector<Shape>&) const override { return true; }

  Kernel bind(const Binding& binding) const override {
    return {"decode-regions", [offsets = offsets_, rows = binding.inputs[0][0]](const Call& call) {
              decode_regions(offsets, rows, call.inputs[0], call.inputs[1], call.outputs[0]);
            }};
  }

 private:
  BoxOffsets offsets_;
};

/// Size of the boxes for zero offsets [pixels].
struct Field {
  float w, h;
};

struct FieldMap {
  int64_t h = 1, w = 1;
  int64_t channels = 1;  // score channels
  float stride = 1;      // image pixels per cell
  std::vector<Field> fields;

  int64_t cells() const { return h * w; }
  int64_t n_boxes() const { return cells() * static_cast<int64_t>(fields.size()); }
};

/// Corners and size [pixels]. The problem defines whether the size includes both ends.
struct FieldBox {
  float x1, y1, x2, y2, w, h;
};

/// Denominator of the overlap of two boxes.
enum class OverlapOf { kUnion, kSmaller, kBetter };

struct FieldProblem {
  int64_t images = 1;
  std::vector<FieldMap> maps;
  bool grouped = false;  // BoxGroupOutput
  BoxOffsets offsets;
  float min_shift = 0, max_shift = 0, min_scale = 0, max_scale = 0;
  float foreground_threshold = 0, overlap_threshold = 0, least_size = 0;
  OverlapOf overlap_of = OverlapOf::kUnion;
  int64_t max_candidates = 0, most_kept = 0;  // per image; 0: all

  int64_t n_boxes() const {
    int64_t n = 0;
    for (const FieldMap& map : maps) n += map.n_boxes();
    return n;
  }
  int64_t most_rows() const {
    int64_t most = n_boxes();
    for (const int64_t limit : {max_candidates, most_kept})
      if (limit > 0) most = std::min(most, limit);
    return images * most;
  }
  int64_t scratch_floats() const {
    return n_boxes() * static_cast<int64_t>((sizeof(FieldBox) + sizeof(Candidate)) / sizeof(float));
  }
};

/// Clamps to [least, most]; NaN becomes a limit.
float limited(float least, float value, float most) {
  return std::min(most, std::max(least, value));
}

/// Clips to the image. Offsets are `cells` apart.
FieldBox field_box(const FieldProblem& p, const FieldMap& map, const Field& field, int64_t cell,
                   const float* first) {
  std::array<float, 4> t{};
  for (size_t i = 0; i < 4; ++i) {
    const float number = first[static_cast<int64_t>(i) * map.cells()];
    t[i] = p.offsets.apply(i, number);
    t[i] =
        i < 2 ? limited(p.min_shift, t[i], p.max_shift) : limited(p.min_scale, t[i], p.max_scale);
  }
  const auto center = [&](int64_t index) {
    return (static_cast<float>(index) + 0.5F) * map.stride;
  };
  const float w = field.w * std::exp(t[2]), h = field.h * std::exp(t[3]);
  const float x = t[0] * field.w + center(cell % map.w) - w / 2;
  const float y = t[1] * field.h + center(cell / map.w) - h / 2;
  const float image_w = static_cast<float>(map.w) * map.stride;
  const float image_h = static_cast<float>(map.h) * map.stride;
  const float x1 = std::max(0.0F, x), y1 = std::max(0.0F, y);
  if (p.grouped) {
    const float x2 = std::min(image_w, x + w - 1), y2 = std::min(image_h, y + h - 1);
    return {x1, y1, x2, y2, x2 - x1 + 1, y2 - y1 + 1};
  }
  const float cut_w = std::min(w, image_w - x1), cut_h = std::min(h, image_h - y1);
  return {x1, y1, x1 + cut_w, y1 + cut_h, cut_w, cut_h};
}

/// Expects scores `cells` apart, the background's first. Ignores NaN among the others.
float foreground(const FieldProblem& p, const FieldMap& map, const float* scores) {
  if (p.grouped) return 1 - scores[0];
  float best = -FLT_MAX;
  for (int64_t c = 1; c < map.channels; ++c) best = std::max(best, scores[c * map.cells()]);
  return best - scores[0];
}

float field_overlap(const FieldProblem& p, const FieldBox& better, const FieldBox& other) {
  const auto empty = [&](const FieldBox& box) {
    return p.grouped ? box.x2 < box.x1 || box.y2 < box.y1 : box.w <= 0 || box.h <= 0;
  };
  if (empty(better) || empty(other)) return 0;
  const float x1 = std::max(better.x1, other.x1), y1 = std::max(better.y1, other.y1);
  const float x2 = std::min(better.x2, other.x2), y2 = std::min(better.y2, other.y2);
  const bool apart = y1 >= y2 || (p.grouped ? x1 > x2 : x1 >= x2);  // as in the original layers
  const float end = p.grouped ? 1 : 0;
  const float both = apart ? 0 : (x2 - x1 + end) * (y2 - y1 + end);
  const float area = better.w * better.h, other_area = other.w * other.h;
  if (p.overlap_of == OverlapOf::kSmaller) return both / std::min(area, other_area);
  return both / (p.overlap_of == OverlapOf::kBetter ? area : area + other_area - both);
}

struct FieldInput {
  const float *scores, *offsets;
};
FieldInput field_input(const FieldProblem& p, const std::vector<const float*>& inputs, size_t m,
                       int64_t image, size_t field) {
  const FieldMap& map = p.maps[m];
  const int64_t cells = map.cells();
  if (!p.grouped) {
    const float* scores = inputs[m] + image * (map.channels + 4) * cells;
    return {scores, scores + map.channels * cells};
  }
  const auto n_fields = static_cast<int64_t>(map.fields.size());
  const int64_t item = image * n_fields + static_cast<int64_t>(field);
  return {inputs[2 * m] + item * map.channels * cells, inputs[2 * m + 1] + item * 4 * cells};
}

int64_t field_candidates(const FieldProblem& p, const std::vector<const float*>& inputs,
                         int64_t image, FieldBox* boxes, Candidate* candidates) {
  int64_t found = 0;
  for (size_t m = 0; m < p.maps.size(); ++m) {
    const FieldMap& map = p.maps[m];
    for (size_t k = 0; k < map.fields.size(); ++k) {
      const FieldInput in = field_input(p, inputs, m, image, k);
      for (int64_t cell = 0; cell < map.cells(); ++cell) {
        const float score = foreground(p, map, in.scores + cell);
        if (!(score >= p.foreground_threshold)) continue;
        const FieldBox box = field_box(p, map, map.fields[k], cell, in.offsets + cell);
        if (!(box.w >= p.least_size && box.h >= p.least_size)) continue;
        boxes[found] = box;
        candidates[found] = {score, static_cast<int32_t>(found)};
        ++found;
      }
    }
  }
  return found;
}

/// Writes rows of image, x1, y1, x2, y2, and to a second output these with the score, by image,
/// best first. For equal scores BoxOutput prefers the later box. The original BoxGroupOutput leaves
/// their order to std::partial_sort; here the earlier comes first. Without any box, writes one row
/// with a small box.
int64_t output_boxes(const FieldProblem& p, const Call& call) {
  auto* boxes = reinterpret_cast<FieldBox*>(call.scratch);
  auto* candidates = reinterpret_cast<Candidate*>(boxes + p.n_boxes());
  const bool scored = call.outputs.size() > 1;
  int64_t rows = 0;
  for (int64_t image = 0; image < p.images; ++image) {
    int64_t n = field_candidates(p, call.inputs, image, boxes, candidates);
    std::sort(candidates, candidates + n, [&](const Candidate& a, const Candidate& b) {
      return p.grouped || a.score != b.score ? is_better(a, b) : a.box > b.box;
    });
    if (p.max_candidates > 0) n = std::min(n, p.max_candidates);
    const int64_t most = p.most_kept > 0 ? p.most_kept : n;
    n = keep_unsuppressed(candidates, n, most, [&](const Candidate& a, const Candidate& b) {
      return field_overlap(p, boxes[a.box], boxes[b.box]) > p.overlap_threshold;
    });
    for (int64_t i = 0; i < n; ++i, ++rows) {
      const FieldBox& box = boxes[candidates[i].box];
      const float row[] = {static_cast<float>(image), box.x1, box.y1, box.x2, box.y2,
                           candidates[i].score};
      std::copy_n(row, 5, call.outputs[0] + rows * 5);
      if (scored) std::copy_n(row, 6, call.outputs[1] + rows * 6);
    }
  }
  if (rows > 0) return rows;
  const float nothing[] = {0, 1, 1, 10, 10};
  std::copy_n(nothing, 5, call.outputs[0]);
  if (scored) std::fill_n(call.outputs[1], 6, 0.0F);
  return 1;
}

/// Proposals of MS-CNN (zhaoweicai/mscnn, src/caffe/layers/box_output_layer.cpp) and Cascade R-CNN
/// (zhaoweicai/cascade-rcnn, src/caffe/layers/box_group_output_layer.cpp).
class FieldBoxOutput : public Layer {
 public:
  std::vector<Shape> infer(const std::vector<Shape>& inputs, size_t n_outputs) const override {
    expect_1_or_2(n_outputs, "outputs (boxes; boxes with scores)");
    const int64_t rows = problem(inputs).most_rows();
    std::vector<Shape> outputs{Shape{rows, 5, 1, 1}};
    if (n_outputs == 2) outputs.push_back(Shape{rows, 6, 1, 1});
    return outputs;
  }

  std::optional<size_t> dynamic_axis() const override { return 0; }

  Kernel bind(const Binding& binding) const override {
    const FieldProblem p = problem(binding.inputs);
    return {"decode-suppress-fields", [p](const Call& call) { *call.rows = output_boxes(p, call); },
            floats(p.scratch_floats())};
  }

 protected:
  template <typename Param>
  FieldBoxOutput(const Param& param, const caffe::BBoxRegParameter& offsets) {
    if (!(param.field_whr() > 0 && param.field_xyr() > 0))
      throw InputError("field_whr and field_xyr must be above 0");
    settings_.offsets = BoxOffsets(offsets);
    settings_.min_shift = -1 / param.field_xyr(), settings_.max_shift = 1 / param.field_xyr();
    settings_.min_scale = std::log(1 / param.field_whr());
    settings_.max_scale = std::log(param.field_whr());
    settings_.foreground_threshold = param.fg_thr();
    settings_.overlap_threshold = param.iou_thr();
    settings_.least_size = param.min_size();
    if (param.nms_type() == "IOMU") settings_.overlap_of = OverlapOf::kSmaller;
    if (param.nms_type() == "IOFU") settings_.overlap_of = OverlapOf::kBetter;
    settings_.max_candidates = param.max_nms_num();
    settings_.most_kept = param.max_post_nms_num();
  }

  virtual FieldProblem problem(const std::vector<Shape>& inputs) const = 0;

  FieldProblem settings_;  // maps have only fields and strides

  void add_map(int64_t stride, std::vector<Field> fields) {
    if (stride < 1) throw InputError("a stride or downsample_rate must be at least 1");
    expect_int(stride, "a stride or downsample_rate");
    FieldMap map;
    map.stride = static_cast<float>(stride);
    map.fields = std::move(fields);
    settings_.maps.push_back(std::move(map));
  }

  static void set_sizes(const Shape& scores, int64_t channels, FieldMap* map) {
    map->h = scores[2], map->w = scores[3], map->channels = channels;
  }
};

class BoxOutput : public FieldBoxOutput {
 public:
  explicit BoxOutput(const caffe::LayerParameter& layer)
      : FieldBoxOutput(layer.box_output_param(), layer.bbox_reg_param()) {
    const caffe::BoxOutputParameter& param = layer.box_output_param();
    const int n = param.downsample_rate_size();
    if (n < 1 || param.field_w_size() != n || param.field_h_size() != n)
      throw InputError("expected as many field_w as field_h and downsample_rate, found ",
                       param.field_w_size(), ", ", param.field_h_size(), " and ", n);
    for (int i = 0; i < n; ++i)
      add_map(param.downsample_rate(i),
              {{static_cast<float>(param.field_w(i)), static_cast<float>(param.field_h(i))}});
  }

 private:
  FieldProblem problem(const std::vector<Shape>& inputs) const override {
    FieldProblem p = settings_;
    expect_count(inputs.size(), p.maps.size(), "inputs (one for each downsample_rate)");
    for (size_t i = 0; i < inputs.size(); ++i) {
      expect_image(inputs[i], "BoxOutput");
      if (inputs[i][0] != inputs[0][0] || inputs[i][1] != inputs[0][1] || inputs[i][1] < 6)
        throw InputError(
            "expected inputs of one batch size and one number of channels, at least 2 classes + 4, "
            "found ",
            inputs[0], " and ", inputs[i]);
      set_sizes(inputs[i], inputs[i][1] - 4, &p.maps[i]);
    }
    p.images = inputs[0][0];
    expect_int(p.n_boxes(), "boxes of an image");
    return p;
  }
};

/// Each map has several fields as batch items; scores and offsets are separate blobs.
class BoxGroupOutput : public FieldBoxOutput {
 public:
  explicit BoxGroupOutput(const caffe::LayerParameter& layer)
      : FieldBoxOutput(layer.box_group_output_param(), layer.bbox_reg_param()) {
    settings_.grouped = true;
    for (const caffe::BoxGroupParameter& group : layer.box_group_output_param().box_group_param()) {
      const int n = group.field_w_size();
      if (n < 1 || group.field_h_size() != n)
        throw InputError("expected as many field_w as field_h, found ", n, " and ",
                         group.field_h_size());
      std::vector<Field> fields;
      for (int i = 0; i < n; ++i)
        fields.push_back(
            {static_cast<float>(group.field_w(i)), static_cast<float>(group.field_h(i))});
      add_map(group.stride(), std::move(fields));
    }
    if (settings_.maps.empty()) throw InputError("box_group_param must be given");
  }

 private:
  FieldProblem problem(const std::vector<Shape>& inputs) const override {
    FieldProblem p = settings_;
    expect_count(inputs.size(), 2 * p.maps.size(),
                 "inputs (scores and offsets for each box_group_param)");
    for (size_t i = 0; i < p.maps.size(); ++i) {
      const Shape &scores = inputs[2 * i], &offsets = inputs[2 * i + 1];
      expect_image(scores, "BoxGroupOutput");
      const auto n_fields = static_cast<int64_t>(p.maps[i].fields.size());
      if (i == 0) p.images = scores[0] / n_fields;
      if (p.images < 1 || scores[0] != p.images * n_fields || scores[1] != inputs[0][1])
        throw InputError("expected scores of ", inputs[0][1], " channels for ", n_fields,
                         " boxes of ", std::max<int64_t>(p.images, 1), " images, found ", scores);
      if (const Shape wanted = scores.with(1, 4); offsets != wanted)
        throw InputError("expected offsets ", wanted, " for the scores ", scores, ", found ",
                         offsets);
      set_sizes(scores, scores[1], &p.maps[i]);
    }
    expect_int(p.n_boxes(), "boxes of an image");
    return p;
  }
};

}  // namespace

constinit const LayerEntries kBoxOutputLayers = {
    {"BoxGroupOutput", make<BoxGroupOutput>, "Cascade R-CNN",
     "boxes of several anchors per map after suppression"},
    {"BoxOutput", make<BoxOutput>, "MS-CNN", "boxes of one anchor per map after suppression"},
    {"DecodeBBox", make<DecodeBBox>, "Cascade R-CNN", "regions moved by offsets"},
};

}  // namespace revisit::engine
