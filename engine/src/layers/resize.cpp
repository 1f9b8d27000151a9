#include <algorithm>
#include <limits>

#include "layers/layers.h"
#include "revisit/engine/parallel_for.h"

namespace revisit::engine {
namespace {

/// Bilinear resizing of `planes` images `[h][w]`, cropped to `[cropped_h][cropped_w]` from `crop`
/// pixels at the top and left. Corner pixels map to corner pixels.
struct InterpolationProblem {
  int64_t planes = 1, h = 1, w = 1;
  int64_t crop = 0, cropped_h = 1, cropped_w = 1;
  int64_t out_h = 1, out_w = 1;
  int threads = 1;
};

struct TwoNeighbors {
  int64_t first, second;
  float weight_first, weight_second;
};

TwoNeighbors locate(int64_t out, int64_t out_size, int64_t size) {
  const float ratio =
      out_size > 1 ? static_cast<float>(size - 1) / static_cast<float>(out_size - 1) : 0.0F;
  const float at = ratio * static_cast<float>(out);
  const int64_t first = std::min(static_cast<int64_t>(at), size - 1);
  const float weight = at - static_cast<float>(first);
  return {first, std::min(first + 1, size - 1), 1 - weight, weight};
}

void interpolate(const InterpolationProblem& p, const float* input, float* output) {
  const bool copy = p.out_h == p.cropped_h && p.out_w == p.cropped_w;
  parallel_for(p.planes * p.out_h, p.threads, [&](int64_t item, int) {
    const float* image = input + (item / p.out_h * p.h + p.crop) * p.w + p.crop;
    float* out = output + item * p.out_w;
    const int64_t y = item % p.out_h;
    if (copy) {  // weights of 1 and 0 would propagate NaN of a neighbor
      std::copy_n(image + y * p.w, p.out_w, out);
      return;
    }
    const TwoNeighbors rows = locate(y, p.out_h, p.cropped_h);
    const float *top = image + rows.first * p.w, *bottom = image + rows.second * p.w;
    for (int64_t x = 0; x < p.out_w; ++x) {
      const TwoNeighbors c = locate(x, p.out_w, p.cropped_w);
      out[x] =
          rows.weight_first * (c.weight_first * top[c.first] + c.weight_second * top[c.second]) +
          rows.weight_second *
              (c.weight_first * bottom[c.first] + c.weight_second * bottom[c.second]);
    }
  });
}

class Interp : public OneToOneLayer {
 public:
  explicit Interp(const caffe::InterpParameter& param) : param_(param) {
    if (param.interp_type() != "bilinear")
      throw UnsupportedError("interp_type '", param.interp_type(),
                             "' is not supported (expected 'bilinear')");
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

  Shape output_shape(const Shape& input) const override {
    expect_image(input, "Interp");
    const InterpolationProblem p = problem(input);
    return Shape{input[0], input[1], p.out_h, p.out_w};
  }

  bool keeps_items(size_t, const std::vector<Shape>&) const override { return true; }

  Kernel bind(const Binding& binding) const override {
    InterpolationProblem p = problem(binding.inputs[0]);
    p.threads = binding.threads;
    return {"bilinear", [p](const Call& call) { interpolate(p, call.inputs[0], call.outputs[0]); }};
  }

 private:
  /// In the fork, a single factor takes precedence over the size, and the size over both factors.
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
      throw InputError("cropping by ", p.crop, " and ", crop_end, " leaves nothing of the input (",
                       input, ")");
    p.out_h = output_size(p.cropped_h, param_.height());
    p.out_w = output_size(p.cropped_w, param_.width());
    return p;
  }

  caffe::InterpParameter param_;
};

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
    // DeconvNet's takes the first channels of a longer mask.
    if (inputs.size() == 2 && inputs[1] != input &&
        (input[0] != 1 || inputs[1].rank() != 4 || inputs[1][1] < input[1] ||
         inputs[1].with(1, input[1]) != input))
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

constinit const LayerEntries kResizeLayers = {
    {"Interp", make<Interp, &Parameters::interp_param>, "DeepLab, PSPNet", "bilinear resampling"},
    {"Upsample", make<Upsample, &Parameters::upsample_param>, "SegNet and others",
     "unpooling by mask, or nearest neighbor"},
};

}  // namespace revisit::engine
