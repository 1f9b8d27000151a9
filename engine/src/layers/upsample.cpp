#include <algorithm>
#include <limits>

#include "layers/layers.h"
#include "revisit/engine/parallel_for.h"

namespace revisit::engine {
namespace {

struct UpsamplingProblem {
  int64_t planes = 1, h = 1, w = 1, out_h = 1, out_w = 1;
  int threads = 1;
};

/// Moves each value to its position in the mask of a max pooling (index h * out_w + w); other
/// pixels are zero. If positions repeat, the last value wins. If a plane's mask points outside,
/// where Caffe aborts, the plane becomes NaN.
void upsample_by_mask(const UpsamplingProblem& p, const float* input, const float* mask,
                      float* output) {
  const int64_t pixels = p.h * p.w, out_pixels = p.out_h * p.out_w;
  parallel_for(p.planes, p.threads, [&](int64_t plane, int) {
    const float *in = input + plane * pixels, *where = mask + plane * pixels;
    float* out = output + plane * out_pixels;
    std::fill_n(out, out_pixels, 0.0F);
    for (int64_t i = 0; i < pixels; ++i) {
      if (!(where[i] > -1 && where[i] < static_cast<float>(out_pixels))) {
        std::fill_n(out, out_pixels, std::numeric_limits<float>::quiet_NaN());
        return;
      }
      out[static_cast<int64_t>(where[i])] = in[i];
    }
  });
}

void upsample_nearest(const UpsamplingProblem& p, const float* input, float* output) {
  const int64_t scale_h = p.out_h / p.h, scale_w = p.out_w / p.w;
  parallel_for(p.planes * p.out_h, p.threads, [&](int64_t item, int) {
    const float* in = input + (item / p.out_h * p.h + item % p.out_h / scale_h) * p.w;
    float* out = output + item * p.out_w;
    for (int64_t x = 0; x < p.w; ++x) out = std::fill_n(out, scale_w, in[x]);
  });
}

/// Two inputs: SegNet's layer with a pooling mask. One input: that of the Darknet converters.
class Upsample : public Layer {
 public:
  explicit Upsample(const caffe::UpsampleParameter& param) : param_(param) {}

  std::vector<Shape> infer(const std::vector<Shape>& inputs, size_t n_outputs) const override {
    if (inputs.size() != 1 && inputs.size() != 2)
      throw InputError("expected 1 input, or 2 (the second is a pooling mask), found ",
                       inputs.size());
    expect_count(n_outputs, 1, "outputs");
    const Shape& input = inputs[0];
    expect_image(input, "Upsample");
    if (inputs.size() == 2 && inputs[1] != input)
      throw InputError("the mask must have the shape of the input, ", input, ", found ", inputs[1]);
    const auto [h, w] = inputs.size() == 2 ? masked_size(input) : repeated_size(input);
    return {Shape{input[0], input[1], h, w}};
  }

  Kernel bind(const Binding& binding) const override {
    const Shape &input = binding.inputs[0], &output = binding.outputs[0];
    const UpsamplingProblem p{input[0] * input[1], input[2],  input[3],
                              output[2],           output[3], binding.threads};
    if (binding.inputs.size() == 2)
      return {"upsample-by-mask", [p](const Call& call) {
                upsample_by_mask(p, call.inputs[0], call.inputs[1], call.outputs[0]);
              }};
    return {"upsample-nearest",
            [p](const Call& call) { upsample_nearest(p, call.inputs[0], call.outputs[0]); }};
  }

 private:
  struct Size {
    int64_t h, w;
  };

  Size masked_size(const Shape& input) const {
    if (param_.has_upsample_h() && param_.has_upsample_w()) {
      if (param_.upsample_h() < 2 || param_.upsample_w() < 2)
        throw InputError("upsample_h and upsample_w must be at least 2");
      return {param_.upsample_h(), param_.upsample_w()};
    }
    const bool hw = param_.has_scale_h() || param_.has_scale_w();
    if (hw && (param_.has_scale() || !param_.has_scale_h() || !param_.has_scale_w()))
      throw InputError("give upsample_h and upsample_w, or scale, or scale_h and scale_w");
    const int64_t scale_h = hw ? param_.scale_h() : param_.scale();
    const int64_t scale_w = hw ? param_.scale_w() : param_.scale();
    if (scale_h < 2 || scale_w < 2) throw InputError("the scale must be at least 2");
    if ((param_.pad_out_h() && scale_h != 2) || (param_.pad_out_w() && scale_w != 2))
      throw InputError("pad_out_h and pad_out_w need a scale of 2");
    return {input[2] * scale_h - (param_.pad_out_h() ? 1 : 0),
            input[3] * scale_w - (param_.pad_out_w() ? 1 : 0)};
  }

  Size repeated_size(const Shape& input) const {
    if (!param_.has_scale() || param_.has_scale_h() || param_.has_scale_w() ||
        param_.has_upsample_h() || param_.has_upsample_w() || param_.has_pad_out_h() ||
        param_.has_pad_out_w())
      throw InputError("with one input, which is repeated, give scale and nothing else");
    if (param_.scale() < 1) throw InputError("scale must be at least 1");
    return {input[2] * param_.scale(), input[3] * param_.scale()};
  }

  caffe::UpsampleParameter param_;
};

}  // namespace

std::unique_ptr<Layer> make_upsample(const caffe::LayerParameter& param) {
  return std::make_unique<Upsample>(param.upsample_param());
}

}  // namespace revisit::engine
