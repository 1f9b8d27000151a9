#include <algorithm>
#include <cfloat>
#include <cmath>

#include "kernels/detection.h"
#include "layers/layers.h"

namespace revisit::engine {
namespace {

/// Size of a box [pixels].
struct Size {
  float w, h;
};

// SSD has 6 boxes per cell, of 2 sizes. Limits are needed because boxes are created when a file is
// read, and its text could list millions of sizes and ratios.
constexpr int kMaxListed = 1000;
constexpr size_t kMaxBoxes = 10'000;
constexpr float kLargest = 1e6F;  // [pixels]; also rejects NaN

/// SSD's prior boxes: around the center of each cell of the first input, as fractions of the image,
/// the second input. Output `[1][2][cells * boxes * 4]`: xmin, ymin, xmax, ymax, then variances.
class PriorBox : public Layer {
 public:
  PriorBox(const caffe::PriorBoxParameter& param, bool clustered) : param_(param) {
    check_variances();
    const bool img_hw = param.has_img_h() || param.has_img_w();
    if (img_hw && param.has_img_size())
      throw InputError("give img_size, or img_h and img_w, not both");
    if (img_hw && (param.img_h() < 1 || param.img_w() < 1))
      throw InputError("img_h and img_w must be given together and be at least 1");
    if (param.has_img_size() && param.img_size() < 1)
      throw InputError("img_size must be at least 1");
    const bool step_hw = param.has_step_h() || param.has_step_w();
    if (step_hw && param.has_step()) throw InputError("give step, or step_h and step_w, not both");
    if (step_hw && !(param.step_h() > 0 && param.step_w() > 0))
      throw InputError("step_h and step_w must be given together and be above 0");
    if (param.has_step() && !(param.step() > 0)) throw InputError("step must be above 0");
    if (clustered) {
      boxes_ = given_boxes();
    } else {
      check_sizes();
      boxes_ = boxes_of_a_cell();
    }
  }

  std::vector<Shape> infer(const std::vector<Shape>& inputs, size_t n_outputs) const override {
    expect_count(inputs.size(), 2, "inputs (the feature map and the image)");
    expect_count(n_outputs, 1, "outputs");
    for (const Shape& input : inputs)
      if (input.rank() != 4)
        throw InputError("expected inputs of 4 axes (n x c x h x w), found ", input);
    const auto boxes = static_cast<int64_t>(boxes_.size());
    return {Shape{1, 2, Shape{inputs[0][2], inputs[0][3], boxes, 4}.elements()}};
  }

  Kernel bind(const Binding& binding) const override {
    const Grid grid = grid_for(binding.inputs[0], binding.inputs[1]);
    return {"prior-boxes",
            [boxes = boxes_, grid, clip = param_.clip(), variances = variances_](const Call& call) {
              float* const end = write_boxes(grid, boxes, call.outputs[0]);
              if (clip)
                std::transform(call.outputs[0], end, call.outputs[0],
                               [](float v) { return std::min(std::max(v, 0.0F), 1.0F); });
              const int64_t floats = end - call.outputs[0];
              for (int64_t i = 0; i < floats; ++i) end[i] = variances[static_cast<size_t>(i % 4)];
            }};
  }

 private:
  struct Grid {
    int64_t h, w;              // cells
    int64_t image_h, image_w;  // [pixels]
    float step_h, step_w;      // [pixels]
    float offset;              // center within a cell [cells]
  };

  static void check_listed(int count, const char* what) {
    if (count > kMaxListed)
      throw InputError("expected at most ", kMaxListed, " ", what, ", found ", count);
  }

  static void check_side(float side) {
    if (!(side > 0 && side < kLargest))
      throw InputError("width and height must be above 0, found ", side);
  }

  std::vector<Size> given_boxes() const {
    if (param_.min_size_size() + param_.max_size_size() + param_.aspect_ratio_size() > 0)
      throw InputError("give width and height of the boxes, not min_size, max_size, aspect_ratio");
    check_listed(param_.width_size(), "width");
    if (param_.width_size() < 1 || param_.height_size() != param_.width_size())
      throw InputError("expected as many height as width, at least one, found ",
                       param_.height_size(), " and ", param_.width_size());
    std::vector<Size> boxes;
    for (int i = 0; i < param_.width_size(); ++i) {
      check_side(param_.width(i));
      check_side(param_.height(i));
      boxes.push_back({param_.width(i), param_.height(i)});
    }
    return boxes;
  }

  void check_sizes() const {
    if (param_.width_size() + param_.height_size() > 0)
      throw InputError("width and height are for the type PriorBoxClustered");
    if (param_.min_size_size() < 1) throw InputError("min_size must be given");
    const int n = param_.min_size_size();
    check_listed(n, "min_size");
    check_listed(param_.aspect_ratio_size(), "aspect_ratio");
    if (param_.max_size_size() != 0 && param_.max_size_size() != n)
      throw InputError("expected one max_size for each of ", n, " min_size, or none, found ",
                       param_.max_size_size());
    for (int i = 0; i < n; ++i) {
      if (!(param_.min_size(i) > 0 && param_.min_size(i) < kLargest))
        throw InputError("min_size must be above 0, found ", param_.min_size(i));
      if (param_.max_size_size() > 0 &&
          !(param_.max_size(i) > param_.min_size(i) && param_.max_size(i) < kLargest))
        throw InputError("max_size ", param_.max_size(i), " must be larger than min_size ",
                         param_.min_size(i));
    }
    for (const float ratio : param_.aspect_ratio())
      if (!(ratio > 0)) throw InputError("aspect_ratio must be above 0, found ", ratio);
  }

  void check_variances() {
    const int n = param_.variance_size();
    if (n > 1 && n != 4) throw InputError("expected 1 or 4 variances, found ", n);
    for (const float variance : param_.variance())
      if (!(variance > 0)) throw InputError("variance must be above 0, found ", variance);
    for (int i = 0; i < 4; ++i)
      variances_.push_back(n == 0 ? 0.1F : param_.variance(n == 1 ? 0 : i));
  }

  /// 1, then the given ratios without repetitions, each followed by its inverse if `flip`.
  std::vector<float> aspect_ratios() const {
    std::vector<float> ratios{1};
    for (const float ratio : param_.aspect_ratio()) {
      const auto same = [&](float other) { return std::fabs(ratio - other) < 1e-6; };
      if (std::any_of(ratios.begin(), ratios.end(), same)) continue;
      ratios.push_back(ratio);
      if (param_.flip()) ratios.push_back(static_cast<float>(1.0 / ratio));
    }
    return ratios;
  }

  std::vector<Size> boxes_of_a_cell() const {
    std::vector<Size> boxes;
    const std::vector<float> ratios = aspect_ratios();
    const size_t count =
        static_cast<size_t>(param_.min_size_size()) * ratios.size() + param_.max_size_size();
    if (count > kMaxBoxes)
      throw InputError("expected at most ", kMaxBoxes, " boxes for each cell, found ", count);
    for (int i = 0; i < param_.min_size_size(); ++i) {
      // SSD truncates sizes to integers here.
      const double least = std::trunc(param_.min_size(i));
      boxes.push_back({static_cast<float>(least), static_cast<float>(least)});
      if (param_.max_size_size() > 0) {
        const auto mean = static_cast<float>(std::sqrt(least * std::trunc(param_.max_size(i))));
        boxes.push_back({mean, mean});
      }
      for (size_t r = 1; r < ratios.size(); ++r) {
        const double root = std::sqrt(static_cast<double>(ratios[r]));
        boxes.push_back({static_cast<float>(least * root), static_cast<float>(least / root)});
      }
    }
    return boxes;
  }

  Grid grid_for(const Shape& feature, const Shape& image) const {
    Grid grid{feature[2], feature[3], image[2], image[3], 0, 0, param_.offset()};
    if (param_.has_img_size()) grid.image_h = grid.image_w = param_.img_size();
    if (param_.has_img_h()) grid.image_h = param_.img_h(), grid.image_w = param_.img_w();
    grid.step_h = static_cast<float>(grid.image_h) / static_cast<float>(grid.h);
    grid.step_w = static_cast<float>(grid.image_w) / static_cast<float>(grid.w);
    if (param_.has_step()) grid.step_h = grid.step_w = param_.step();
    if (param_.has_step_h()) grid.step_h = param_.step_h(), grid.step_w = param_.step_w();
    return grid;
  }

  static float* write_boxes(const Grid& grid, const std::vector<Size>& boxes, float* out) {
    for (int64_t y = 0; y < grid.h; ++y)
      for (int64_t x = 0; x < grid.w; ++x) {
        const float center_x = (static_cast<float>(x) + grid.offset) * grid.step_w;
        const float center_y = (static_cast<float>(y) + grid.offset) * grid.step_h;
        const auto w = static_cast<double>(grid.image_w), h = static_cast<double>(grid.image_h);
        for (const Size& box : boxes) {
          *out++ = static_cast<float>((center_x - box.w / 2.0) / w);
          *out++ = static_cast<float>((center_y - box.h / 2.0) / h);
          *out++ = static_cast<float>((center_x + box.w / 2.0) / w);
          *out++ = static_cast<float>((center_y + box.h / 2.0) / h);
        }
      }
    return out;
  }

  caffe::PriorBoxParameter param_;
  std::vector<float> variances_;
  std::vector<Size> boxes_;
};

/// Writes detections `[1][1][rows][7]`. RefineDet's has two more inputs, of its first stage.
class DetectionOutput : public Layer {
 public:
  explicit DetectionOutput(const caffe::DetectionOutputParameter& param) : param_(param) {
    if (param.num_classes() < 1) throw InputError("num_classes must be given and at least 1");
    const caffe::NonMaximumSuppressionParameter& nms = param.nms_param();
    if (!(nms.nms_threshold() >= 0)) throw InputError("nms_threshold must not be negative");
    if (nms.soft_nms()) throw InputError("soft_nms is not supported");
    if (param.no_permute()) throw InputError("no_permute needs 2 x nbottom + 1 inputs");
    if (!(nms.eta() > 0 && nms.eta() <= 1)) throw InputError("eta must be above 0 and at most 1");
  }

  std::vector<Shape> infer(const std::vector<Shape>& inputs, size_t n_outputs) const override {
    const size_t n = inputs.size();
    expect_count(n, std::clamp<size_t>(n, 3, 5),
                 "inputs (locations, confidences, prior boxes; RefineDet: also confidences and "
                 "locations of the first stage)");
    expect_count(n_outputs, 1, "outputs");
    if (param_.has_objectness_score() && n < 4)
      throw InputError(
          "objectness_score needs RefineDet's 4th input, the confidences of its first "
          "stage");
    return {Shape{1, 1, problem(inputs).most_rows(), 7}};
  }

  std::optional<size_t> dynamic_axis() const override { return 2; }

  Kernel bind(const Binding& binding) const override {
    const DetectionProblem p = problem(binding.inputs);
    return {"decode-suppress",
            [p](const Call& call) {
              const size_t n = call.inputs.size();
              const Refinement first{n > 3 ? call.inputs[3] : nullptr,
                                     n > 4 ? call.inputs[4] : nullptr};
              *call.rows = detect(p, call.inputs[0], call.inputs[1], call.inputs[2], first,
                                  call.outputs[0], call.scratch);
            },
            floats(p.scratch_floats())};
  }

 private:
  DetectionProblem problem(const std::vector<Shape>& inputs) const {
    const Shape &locations = inputs[0], &confidences = inputs[1], &priors = inputs[2];
    if (priors.rank() < 3 || priors[0] != 1 || priors[1] != 2 || priors[2] % 4 != 0 ||
        priors.product(3, priors.rank()) != 1)
      throw InputError("expected prior boxes of shape 1 x 2 x (4 per box), found ", priors);
    DetectionProblem p;
    p.priors = priors[2] / 4;
    p.classes = param_.num_classes();
    p.shared_locations = param_.share_location();
    p.images = locations.rank() > 0 ? locations[0] : 1;
    const int64_t numbers = p.priors * (p.shared_locations ? 1 : p.classes) * 4;
    if (locations.rank() < 2 || locations.product(1, locations.rank()) != numbers)
      throw InputError("expected ", numbers, " locations per image for ", p.priors,
                       " prior boxes, found ", locations);
    if (confidences.rank() < 2 || confidences[0] != p.images ||
        confidences.product(1, confidences.rank()) != p.priors * p.classes)
      throw InputError("expected ", p.images, " x ", p.priors * p.classes, " confidences for ",
                       p.priors, " prior boxes and ", p.classes, " classes, found ", confidences);
    for (size_t i = 3; i < inputs.size(); ++i)
      if (const int64_t wanted = p.priors * (i == 3 ? 2 : 4);
          inputs[i].rank() < 2 || inputs[i][0] != p.images ||
          inputs[i].product(1, inputs[i].rank()) != wanted)
        throw InputError("expected ", p.images, " x ", wanted,
                         i == 3 ? " confidences" : " locations", " of RefineDet's first stage for ",
                         p.priors, " prior boxes, found ", inputs[i]);
    p.objectness = param_.objectness_score();
    p.background = param_.background_label_id();
    p.code = code();
    p.variance_in_target = param_.variance_encoded_in_target();
    p.clip = param_.clip();
    p.confidence_threshold =
        param_.has_confidence_threshold() ? param_.confidence_threshold() : -FLT_MAX;
    p.overlap_threshold = param_.nms_param().nms_threshold();
    p.eta = param_.nms_param().eta();
    p.top_k = param_.nms_param().has_top_k() ? param_.nms_param().top_k() : -1;
    p.keep_top_k = param_.keep_top_k();
    return p;
  }

  BoxCode code() const {
    if (param_.code_type() == caffe::PriorBoxParameter::CORNER) return BoxCode::kCorner;
    if (param_.code_type() == caffe::PriorBoxParameter::CENTER_SIZE) return BoxCode::kCenterSize;
    return BoxCode::kCornerSize;
  }

  caffe::DetectionOutputParameter param_;
};

}  // namespace

constinit const LayerEntries kSsdLayers = {
    {"DetectionOutput", make<DetectionOutput, &Parameters::detection_output_param>,
     "SSD, RefineDet", "boxes after decoding and suppression"},
    {"PriorBox", make<PriorBox, &Parameters::prior_box_param, false>, "SSD", "default boxes"},
    {"PriorBoxClustered", make<PriorBox, &Parameters::prior_box_param, true>, "OpenVINO",
     "default boxes of given sizes"},
};

}  // namespace revisit::engine
