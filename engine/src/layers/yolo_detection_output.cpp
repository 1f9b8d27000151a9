#include <algorithm>
#include <cmath>

#include "kernels/detection.h"
#include "layers/layers.h"

namespace revisit::engine {
namespace {

/// Size of an anchor, in the unit of YoloMap::image_w.
struct YoloAnchor {
  float w, h;
};

/// Center and size as fractions of the image.
struct YoloBox {
  float x, y, w, h;
};

/// A feature map of `[anchor][x, y, w, h, object, classes][h][w]`.
struct YoloMap {
  int64_t h = 1, w = 1;
  float image_h = 1, image_w = 1;  // in the unit of the anchors
  std::vector<YoloAnchor> anchors;

  int64_t n_boxes() const { return h * w * static_cast<int64_t>(anchors.size()); }
};

struct YoloProblem {
  std::vector<YoloMap> maps;
  int64_t classes = 1;
  float confidence_threshold = 0, overlap_threshold = 0;
  bool each_class = false;  // YOLO v3: a box can be detected as several classes

  int64_t n_boxes() const {
    int64_t n = 0;
    for (const YoloMap& map : maps) n += map.n_boxes();
    return n;
  }
  int64_t most_rows() const { return n_boxes() * (each_class ? classes : 1); }
  int64_t scratch_floats() const {
    return (n_boxes() * static_cast<int64_t>(sizeof(YoloBox)) +
            most_rows() * static_cast<int64_t>(sizeof(Candidate))) /
           static_cast<int64_t>(sizeof(float));
  }
};

float yolo_sigmoid(float x) {
  return static_cast<float>(1 / (1 + std::exp(-double{x})));
}

float shared_length(float center_a, float size_a, float center_b, float size_b) {
  const float first = std::max(center_a - size_a / 2, center_b - size_b / 2);
  const float last = std::min(center_a + size_a / 2, center_b + size_b / 2);
  return last - first;
}

float yolo_overlap(const YoloBox& a, const YoloBox& b) {
  const float w = shared_length(a.x, a.w, b.x, b.w), h = shared_length(a.y, a.h, b.y, b.h);
  const float both = w < 0 || h < 0 ? 0 : w * h;
  return both / (a.w * a.h + b.w * b.h - both);
}

class YoloNumbers {
 public:
  YoloNumbers(const float* first, int64_t stride) : first_(first), stride_(stride) {}
  float operator[](int64_t i) const { return first_[i * stride_]; }
  float object() const { return yolo_sigmoid((*this)[4]); }
  float class_score(int64_t label) const { return (*this)[5 + label]; }

 private:
  const float* first_;
  int64_t stride_;
};

/// Applies a softmax. Returns the first of equal classes. NaN of any class becomes the score.
Candidate best_class(const YoloNumbers& box, int64_t classes) {
  float largest = box.class_score(0), sum = 0;
  for (int64_t c = 1; c < classes; ++c)
    if (box.class_score(c) > largest) largest = box.class_score(c);
  const auto power = [&](int64_t c) { return std::exp(box.class_score(c) - largest); };
  for (int64_t c = 0; c < classes; ++c) sum += power(c);
  Candidate best{power(0) / sum, 0};
  for (int64_t c = 1; c < classes; ++c)
    if (const float share = power(c) / sum; share > best.score)
      best = {share, static_cast<int32_t>(c)};
  return best;
}

YoloBox yolo_box(const YoloMap& map, const YoloAnchor& anchor, int64_t cell,
                 const YoloNumbers& numbers) {
  const int64_t row = cell / map.w, column = cell % map.w;
  return {(static_cast<float>(column) + yolo_sigmoid(numbers[0])) / static_cast<float>(map.w),
          (static_cast<float>(row) + yolo_sigmoid(numbers[1])) / static_cast<float>(map.h),
          std::exp(numbers[2]) * anchor.w / map.image_w,
          std::exp(numbers[3]) * anchor.h / map.image_h};
}

/// Orders by map, cell, anchor, class. `Candidate::box` is index of the box * classes + class.
int64_t yolo_candidates(const YoloProblem& p, const std::vector<const float*>& inputs,
                        YoloBox* boxes, Candidate* candidates) {
  int64_t found = 0, box = 0;
  for (size_t m = 0; m < p.maps.size(); ++m) {
    const YoloMap& map = p.maps[m];
    const int64_t cells = map.h * map.w, numbers = 5 + p.classes;
    for (int64_t cell = 0; cell < cells; ++cell)
      for (size_t anchor = 0; anchor < map.anchors.size(); ++anchor, ++box) {
        const YoloNumbers of_box(inputs[m] + static_cast<int64_t>(anchor) * numbers * cells + cell,
                                 cells);
        boxes[box] = yolo_box(map, map.anchors[anchor], cell, of_box);
        const float object = of_box.object();
        const auto candidate = [&](float score, int64_t label) {
          return Candidate{score, static_cast<int32_t>(box * p.classes + label)};
        };
        if (p.each_class) {
          // Only the best class is needed: it suppresses the others, or whatever suppresses it also
          // suppresses the others.
          const bool only_best = yolo_overlap(boxes[box], boxes[box]) >= p.overlap_threshold;
          const int64_t first = found;
          for (int64_t c = 0; c < p.classes; ++c) {
            const float score = yolo_sigmoid(of_box.class_score(c)) * object;
            if (!(score > p.confidence_threshold)) continue;
            if (!only_best || found == first)
              candidates[found++] = candidate(score, c);
            else if (score > candidates[first].score)
              candidates[first] = candidate(score, c);
          }
        } else {
          const Candidate best = best_class(of_box, p.classes);
          if (const float score = object * best.score; score >= p.confidence_threshold)
            candidates[found++] = candidate(score, best.box);
        }
      }
  }
  return found;
}

/// Writes rows of image, class from 1, score, xmin, ymin, xmax, ymax, best first; without
/// detections one row of the image and -1. Boxes suppress those of other classes, too. Equal
/// scores, whose order the original leaves to std::sort, stay in candidate order.
int64_t detect_yolo(const YoloProblem& p, const std::vector<const float*>& inputs, float* output,
                    float* scratch) {
  auto* boxes = reinterpret_cast<YoloBox*>(scratch);
  auto* candidates = reinterpret_cast<Candidate*>(boxes + p.n_boxes());
  const int64_t found = yolo_candidates(p, inputs, boxes, candidates);
  std::sort(candidates, candidates + found, is_better);
  const auto box_of = [&](const Candidate& candidate) -> const YoloBox& {
    return boxes[candidate.box / p.classes];
  };
  const int64_t kept =
      keep_unsuppressed(candidates, found, found, [&](const Candidate& a, const Candidate& b) {
        return yolo_overlap(box_of(a), box_of(b)) >= p.overlap_threshold;
      });
  for (int64_t i = 0; i < kept; ++i) {
    const YoloBox& box = box_of(candidates[i]);
    const auto label = static_cast<float>(candidates[i].box % p.classes + 1);
    const float row[] = {0,
                         label,
                         candidates[i].score,
                         box.x - box.w / 2,
                         box.y - box.h / 2,
                         box.x + box.w / 2,
                         box.y + box.h / 2};
    output = std::copy(std::begin(row), std::end(row), output);
  }
  if (kept > 0) return kept;
  *output = 0;
  std::fill_n(output + 1, 6, -1.0F);
  return 1;
}

/// Output layer of YOLO v2 and v3 (eric612/MobileNet-YOLO,
/// src/caffe/layers/yolo_detection_output_layer.cpp and yolov3_detection_output_layer.cpp):
/// detections `[1][1][rows][7]` from feature maps.
class YoloDetectionOutput : public Layer {
 public:
  /// YOLO v2: anchors in cells, equal for both maps.
  explicit YoloDetectionOutput(const caffe::YoloDetectionOutputParameter& param)
      : YoloDetectionOutput(param, false) {
    if (param.coords() != 4) throw InputError("coords must be 4, found ", param.coords());
    anchor(n_anchors_ - 1);
  }

  /// YOLO v3: each map has its own anchors, in pixels, and its own number of pixels per cell.
  explicit YoloDetectionOutput(const caffe::Yolov3DetectionOutputParameter& param)
      : YoloDetectionOutput(param, true) {
    if (param.gaussian_box())
      throw UnsupportedError(
          "gaussian_box is not supported: the original's results on a CPU depend on uninitialized "
          "memory");
    mask_.assign(param.mask().begin(), param.mask().end());
    anchors_scale_.assign(param.anchors_scale().begin(), param.anchors_scale().end());
    const int64_t n_maps = param.mask_group_num();
    if (n_maps < 1) throw InputError("mask_group_num must be at least 1");
    if (std::ssize(mask_) != n_maps * n_anchors_)
      throw InputError("expected a mask for each of ", n_maps, " mask groups x ", n_anchors_,
                       " boxes, found ", mask_.size());
    if (std::ssize(anchors_scale_) != n_maps)
      throw InputError("expected an anchors_scale for each of ", n_maps, " mask groups, found ",
                       anchors_scale_.size());
    for (const int64_t mask : mask_) anchor(mask);
    for (const int64_t scale : anchors_scale_)
      if (scale < 1) throw InputError("anchors_scale must be at least 1");
  }

  std::vector<Shape> infer(const std::vector<Shape>& inputs, size_t n_outputs) const override {
    expect_count(n_outputs, 1, "outputs");
    return {Shape{1, 1, problem(inputs).most_rows(), 7}};
  }

  std::optional<size_t> dynamic_axis() const override { return 2; }

  Kernel bind(const Binding& binding) const override {
    const YoloProblem p = problem(binding.inputs);
    return {"decode-suppress-yolo",
            [p](const Call& call) {
              *call.rows = detect_yolo(p, call.inputs, call.outputs[0], call.scratch);
            },
            floats(p.scratch_floats())};
  }

 private:
  template <typename Param>
  YoloDetectionOutput(const Param& param, bool is_v3)
      : biases_(param.biases().begin(), param.biases().end()), n_anchors_(param.num_box()) {
    if (!param.has_num_classes() || param.num_classes() < 1)
      throw InputError("num_classes must be given and at least 1");
    if (n_anchors_ < 1) throw InputError("num_box must be at least 1");
    expect_int(n_anchors_, "num_box");
    expect_int(param.num_classes(), "num_classes");
    settings_.each_class = is_v3;
    settings_.classes = param.num_classes();
    settings_.confidence_threshold = param.confidence_threshold();
    settings_.overlap_threshold = param.nms_threshold();
  }

  YoloAnchor anchor(int64_t index) const {
    const int64_t found = std::ssize(biases_);
    if (2 * index + 1 >= found)
      throw InputError("expected at least ", 2 * index + 2, " biases, two for each of ", index + 1,
                       " anchors, found ", found);
    return {biases_[static_cast<size_t>(2 * index)], biases_[static_cast<size_t>(2 * index + 1)]};
  }

  YoloMap map_of(const Shape& input, size_t i) const {
    const bool is_v3 = settings_.each_class;
    expect_image(input, "YOLO");
    if (input[0] != 1)
      throw InputError("expected a batch of 1 image, found ", input[0],
                       ": the original assigns the boxes of all images to the first");
    const int64_t channels = n_anchors_ * (5 + settings_.classes);
    if (input[1] != channels)
      throw InputError("expected ", channels,
                       " channels, 5 + num_classes = ", 5 + settings_.classes, " for each of ",
                       n_anchors_, " boxes, found ", input);
    YoloMap map{input[2], input[3]};
    if (!is_v3 && map.h != map.w)
      throw InputError("expected a square map, because the original assumes one, found ", input);
    const int64_t scale = is_v3 ? anchors_scale_[i] : 1;
    expect_int(std::max(map.h, map.w) * scale, "anchors_scale times the size of the map");
    map.image_h = static_cast<float>(map.h * scale),
    map.image_w = static_cast<float>(map.w * scale);
    for (int64_t k = 0; k < n_anchors_; ++k)
      map.anchors.push_back(anchor(is_v3 ? mask_[i * static_cast<size_t>(n_anchors_) + k] : k));
    return map;
  }

  YoloProblem problem(const std::vector<Shape>& inputs) const {
    if (settings_.each_class)
      expect_count(inputs.size(), anchors_scale_.size(), "inputs (mask_group_num)");
    else
      expect_1_or_2(inputs.size(), "inputs");
    YoloProblem p = settings_;
    for (size_t i = 0; i < inputs.size(); ++i) p.maps.push_back(map_of(inputs[i], i));
    expect_int(p.n_boxes() * p.classes, "boxes times classes");
    return p;
  }

  YoloProblem settings_;  // without maps
  std::vector<float> biases_;
  int64_t n_anchors_;
  std::vector<int64_t> mask_, anchors_scale_;  // YOLO v3
};

}  // namespace

constinit const LayerEntries kYoloDetectionOutputLayers = {
    {"YoloDetectionOutput", make<YoloDetectionOutput, &Parameters::yolo_detection_output_param>,
     "MobileNet-YOLO", "boxes of YOLO v2 after suppression"},
    {"Yolov3DetectionOutput", make<YoloDetectionOutput, &Parameters::yolov3_detection_output_param>,
     "MobileNet-YOLO", "boxes of YOLO v3 after suppression"},
};

}  // namespace revisit::engine
