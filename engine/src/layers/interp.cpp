#include "kernels/interpolate.h"
#include "layers/layers.h"

namespace revisit::engine {
namespace {

/// Bilinear resizing of DeepLab and PSPNet: corner pixels stay corner pixels.
class Interp : public Layer {
 public:
  explicit Interp(const caffe::InterpParameter& param) : param_(param) {
    if (param.interp_type() != "bilinear")
      throw UnsupportedError(
          str("interp_type '", param.interp_type(), "' is not supported ('bilinear' is)"));
    if (param.pad_beg() > 0 || param.pad_end() > 0)
      throw InputError("pad_beg and pad_end must not be positive: they only crop");
    if (param.has_shrink_factor() && param.shrink_factor() < 1)
      throw InputError("shrink_factor must be at least 1");
    if (param.has_zoom_factor() && param.zoom_factor() < 1)
      throw InputError("zoom_factor must be at least 1");
    if (takes_size()) {
      if (param.height() < 1 || param.width() < 1)
        throw InputError("height and width must be at least 1");
    } else if (!param.has_shrink_factor() && !param.has_zoom_factor()) {
      throw InputError("give height and width, or zoom_factor, or shrink_factor");
    }
  }

  std::vector<Shape> infer(const std::vector<Shape>& inputs, size_t n_outputs) const override {
    expect_count(inputs.size(), 1, "inputs");
    expect_count(n_outputs, 1, "outputs");
    if (inputs[0].rank() != 4)
      throw InputError(str("Interp needs an input of 4 axes (n x c x h x w), found ", inputs[0]));
    const InterpolationProblem p = problem(inputs[0]);
    return {Shape{inputs[0][0], inputs[0][1], p.out_h, p.out_w}};
  }

  Kernel bind(const Binding& binding) const override {
    InterpolationProblem p = problem(binding.inputs[0]);
    p.threads = binding.threads;
    return {"bilinear", [p](const Call& call) { interpolate(p, call.inputs[0], call.outputs[0]); }};
  }

 private:
  /// In the fork a single factor goes before the size, and the size before both factors.
  bool takes_size() const {
    return param_.has_height() && param_.has_width() &&
           param_.has_shrink_factor() == param_.has_zoom_factor();
  }

  int64_t output_size(int64_t size, int64_t given) const {
    if (takes_size()) return given;
    const int64_t shrunk = (size - 1) / param_.shrink_factor() + 1;
    return shrunk + (shrunk - 1) * (param_.zoom_factor() - 1);
  }

  InterpolationProblem problem(const Shape& input) const {
    InterpolationProblem p;
    p.planes = input[0] * input[1];
    p.h = input[2], p.w = input[3];
    const int64_t crop_end = -static_cast<int64_t>(param_.pad_end());
    p.crop = -static_cast<int64_t>(param_.pad_beg());
    p.cropped_h = p.h - p.crop - crop_end;
    p.cropped_w = p.w - p.crop - crop_end;
    if (p.cropped_h < 1 || p.cropped_w < 1)
      throw InputError(str("cropping by ", p.crop, " and ", crop_end,
                           " leaves nothing of the input (", input, ")"));
    p.out_h = output_size(p.cropped_h, param_.height());
    p.out_w = output_size(p.cropped_w, param_.width());
    return p;
  }

  caffe::InterpParameter param_;
};

}  // namespace

std::unique_ptr<Layer> make_interp(const caffe::LayerParameter& param) {
  return std::make_unique<Interp>(param.interp_param());
}

}  // namespace revisit::engine
