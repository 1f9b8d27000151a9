#include <cfloat>

#include "kernels/detection.h"
#include "layers/layers.h"

namespace revisit::engine {
namespace {

/// Writes detections `[1][1][rows][7]`.
class DetectionOutput : public Layer {
 public:
  explicit DetectionOutput(const caffe::DetectionOutputParameter& param) : param_(param) {
    if (param.num_classes() < 1) throw InputError("num_classes must be given and at least 1");
    const caffe::NonMaximumSuppressionParameter& nms = param.nms_param();
    if (!(nms.nms_threshold() >= 0)) throw InputError("nms_threshold must not be negative");
    if (!(nms.eta() > 0 && nms.eta() <= 1)) throw InputError("eta must be above 0 and at most 1");
  }

  std::vector<Shape> infer(const std::vector<Shape>& inputs, size_t n_outputs) const override {
    expect_count(inputs.size(), 3, "inputs (locations, confidences, prior boxes)");
    expect_count(n_outputs, 1, "outputs");
    return {Shape{1, 1, problem(inputs).most_rows(), 7}};
  }

  std::optional<size_t> dynamic_axis() const override { return 2; }

  Kernel bind(const Binding& binding) const override {
    const DetectionProblem p = problem(binding.inputs);
    return {"decode-suppress",
            [p](const Call& call) {
              *call.rows = detect(p, call.inputs[0], call.inputs[1], call.inputs[2],
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
    p.background = param_.background_label_id();
    p.code = code();
    p.variance_in_target = param_.variance_encoded_in_target();
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

std::unique_ptr<Layer> make_detection_output(const caffe::LayerParameter& param) {
  return std::make_unique<DetectionOutput>(param.detection_output_param());
}

}  // namespace revisit::engine
