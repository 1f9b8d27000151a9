#include "kernels/roi_pooling.h"

#include <cmath>

#include "layers/layers.h"

namespace revisit::engine {
namespace {

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
      throw InputError(str("expected a feature map of 4 axes (n x c x h x w), found ", input));
    if (rois.rank() < 1 || rois.product(1, rois.rank()) != 5)
      throw InputError(str(
          "expected regions of 5 numbers (image, x1, y1, x2, y2), found an input of shape ", rois));
    return {Shape{rois[0], input[1], param_.pooled_h(), param_.pooled_w()}};
  }

  Kernel bind(const Binding& binding) const override {
    const Shape& input = binding.inputs[0];
    const RoiPoolingProblem p{input[0],
                              input[1],
                              input[2],
                              input[3],
                              binding.inputs[1][0],
                              param_.pooled_h(),
                              param_.pooled_w(),
                              param_.spatial_scale(),
                              binding.threads};
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
