#include <cmath>

#include "layers/layers.h"
#include "layers/pooling_window.h"

namespace revisit::engine {

PoolingWindow::PoolingWindow(const caffe::PoolingParameter& param) : param_(param) {
  // With kernel_size, one of kernel_h and kernel_w alone is ignored.
  const bool has_hw = param.has_kernel_h() && param.has_kernel_w();
  if (param.global_pooling()) {
    if (param.has_kernel_size() || param.has_kernel_h() || param.has_kernel_w())
      throw InputError("global pooling takes no kernel size");
  } else if (param.has_kernel_size() == has_hw) {
    throw InputError("give kernel_size, or both kernel_h and kernel_w (and not both forms)");
  }
  if (param.has_pad() && (param.has_pad_h() || param.has_pad_w()))
    throw InputError("give pad, or pad_h and pad_w, not both");
  if (param.has_pad_h() != param.has_pad_w())
    throw InputError("pad_h and pad_w must be given together");
  if (param.has_stride() && (param.has_stride_h() || param.has_stride_w()))
    throw InputError("give stride, or stride_h and stride_w, not both");
  if (param.has_stride_h() != param.has_stride_w())
    throw InputError("stride_h and stride_w must be given together");
  if (param.has_ceil_mode() && param.has_round_mode())
    throw InputError("give round_mode or ceil_mode, not both");
  if (param.pool() == caffe::PoolingParameter::STOCHASTIC)
    throw UnsupportedError("stochastic pooling is not supported (Caffe runs it on a GPU only)");
  h_ = axis(param.kernel_h(), param.stride_h(), param.has_stride_h(), param.pad_h(),
            param.has_pad_h());
  w_ = axis(param.kernel_w(), param.stride_w(), param.has_stride_w(), param.pad_w(),
            param.has_pad_w());
}

PoolingProblem PoolingWindow::problem(const Shape& input) const {
  expect_image(input, "pooling");
  const Window h = global(h_, input[2]), w = global(w_, input[3]);
  PoolingProblem p;
  p.planes = input[0] * input[1];
  p.h = input[2], p.w = input[3];
  p.out_h = size(p.h, h), p.out_w = size(p.w, w);
  p.kernel_h = h.extent, p.kernel_w = w.extent;
  p.stride_h = h.stride, p.stride_w = w.stride;
  p.pad_h = h.pad, p.pad_w = w.pad;
  return p;
}

std::optional<WindowHw> PoolingWindow::window() const {
  if (param_.global_pooling()) return std::nullopt;
  return WindowHw{h_, w_};
}

Window PoolingWindow::axis(uint32_t kernel, uint32_t stride, bool has_stride, uint32_t pad,
                           bool has_pad) const {
  const Window result{param_.has_kernel_size() ? param_.kernel_size() : kernel,
                      has_stride ? stride : param_.stride(), has_pad ? pad : param_.pad()};
  if (param_.global_pooling()) {
    if (result.stride != 1 || result.pad != 0)
      throw InputError("global pooling needs stride 1 and no pad");
    return result;
  }
  expect_int(result.extent, "the kernel size");
  expect_int(result.stride, "the stride");
  if (result.extent < 1) throw InputError("the kernel size must be at least 1");
  if (result.stride < 1) throw InputError("the stride must be at least 1");
  if (result.pad >= result.extent)
    throw InputError("pad ", result.pad, " must be smaller than the kernel ", result.extent);
  return result;
}

Window PoolingWindow::global(const Window& axis, int64_t input) const {
  return param_.global_pooling() ? Window{input, 1, 0} : axis;
}

/// docs/LAYERS.md point 1. Computed in float, like in Caffe.
int64_t PoolingWindow::size(int64_t input, const Window& axis) const {
  const bool floor = param_.has_ceil_mode() ? !param_.ceil_mode()
                                            : param_.round_mode() == caffe::PoolingParameter::FLOOR;
  const float steps =
      static_cast<float>(input + 2 * axis.pad - axis.extent) / static_cast<float>(axis.stride);
  int64_t out = static_cast<int64_t>(floor ? std::floor(steps) : std::ceil(steps)) + 1;
  // The last window must start inside the image or its leading pad, once any axis is padded.
  if ((h_.pad || w_.pad) && (out - 1) * axis.stride >= input + axis.pad) --out;
  if (out < 1)
    throw InputError("a kernel of ", axis.extent, " does not fit into ", input, " + 2 x ", axis.pad,
                     ": the output would be empty");
  return out;
}

namespace {

class Pooling : public Layer {
 public:
  explicit Pooling(const caffe::PoolingParameter& param) : window_(param) {}

  std::vector<Shape> infer(const std::vector<Shape>& inputs, size_t n_outputs) const override {
    expect_count(inputs.size(), 1, "inputs");
    const bool max = window_.is_max();
    if (n_outputs < 1 || n_outputs > (max ? 2 : 1))
      throw InputError("expected ", max ? "1 or 2 outputs (the second is the mask)" : "1 output",
                       ", found ", n_outputs);
    const PoolingProblem p = window_.problem(inputs[0]);
    return std::vector<Shape>(n_outputs, Shape{inputs[0][0], inputs[0][1], p.out_h, p.out_w});
  }

  std::optional<WindowHw> window(const Shape&) const override { return window_.window(); }

  bool keeps_items(size_t, const std::vector<Shape>&) const override { return true; }

  Rounding rounding() const override {
    return window_.is_max() ? Rounding::kNone : Rounding::kAveraged;
  }

  Form form(const std::vector<Shape>& inputs, const std::vector<Tensor>&) const override {
    const PoolingProblem problem = window_.problem(inputs[0]);
    return window_.is_max() ? Form(problem) : Form(Averaging{problem});
  }

  Kernel bind(const Binding& binding) const override {
    PoolingProblem problem = window_.problem(binding.inputs[0]);
    problem.threads = binding.threads;
    problem.values = binding.precision;
    if (!window_.is_max())
      return {"average-pool", [problem](const Call& call) {
                average_pool(problem, call.inputs[0], call.outputs[0]);
              }};
    return {"max-pool", [problem](const Call& call) {
              max_pool(problem, call.inputs[0], call.outputs[0],
                       call.outputs.size() > 1 ? call.outputs[1] : nullptr);
            }};
  }

 private:
  PoolingWindow window_;
};

/// Spatial pyramid pooling (He et al. 2014): level i pools the image into 2^i x 2^i bins.
class Spp : public OneToOneLayer {
 public:
  explicit Spp(const caffe::SPPParameter& param) : param_(param) {
    if (param.pyramid_height() < 1) throw InputError("pyramid_height must be at least 1");
    if (param.pool() == caffe::SPPParameter::STOCHASTIC)
      throw UnsupportedError("stochastic pooling is not supported (Caffe runs it on a GPU only)");
  }

  Shape output_shape(const Shape& input) const override {
    const std::vector<PoolingProblem> levels = levels_of(input);
    // A pyramid of one level is a pooling layer, whose output is not flattened.
    if (levels.size() == 1) return Shape{input[0], input[1], levels[0].out_h, levels[0].out_w};
    return Shape{input[0], input[1] * bins(levels)};
  }

  bool keeps_items(size_t, const std::vector<Shape>&) const override { return true; }

  Kernel bind(const Binding& binding) const override {
    std::vector<PoolingProblem> levels = levels_of(binding.inputs[0]);
    for (PoolingProblem& level : levels) {
      // planes of one image, because levels alternate with images
      level.planes = binding.inputs[0][1];
      level.threads = binding.threads;
      level.values = binding.precision;
    }
    const bool max = param_.pool() == caffe::SPPParameter::MAX;
    return {"pyramid-pool", [levels, max, images = binding.inputs[0][0]](const Call& call) {
              float* out = call.outputs[0];
              for (int64_t n = 0; n < images; ++n)
                for (const PoolingProblem& level : levels) {
                  const float* image = call.inputs[0] + n * level.planes * level.h * level.w;
                  if (max)
                    max_pool(level, image, out, nullptr);
                  else
                    average_pool(level, image, out);
                  out += level.planes * level.out_h * level.out_w;
                }
            }};
  }

 private:
  static int64_t bins(const std::vector<PoolingProblem>& levels) {
    int64_t sum = 0;
    for (const PoolingProblem& level : levels) sum += level.out_h * level.out_w;
    return sum;
  }

  /// Returns kernel and pad. Follows Caffe's rule: the pad is half of the missing pixels, rounded
  /// up.
  static std::pair<uint32_t, uint32_t> cover(int64_t size, int64_t n_bins) {
    const int64_t kernel = (size + n_bins - 1) / n_bins;
    const int64_t pad = (kernel * n_bins - size + 1) / 2;
    return {static_cast<uint32_t>(kernel), static_cast<uint32_t>(pad)};
  }

  std::vector<PoolingProblem> levels_of(const Shape& input) const {
    expect_image(input, "SPP");
    std::vector<PoolingProblem> levels;
    for (uint32_t level = 0; level < param_.pyramid_height(); ++level) {
      const int64_t n_bins = int64_t{1} << level;
      const auto [kernel_h, pad_h] = cover(input[2], n_bins);
      const auto [kernel_w, pad_w] = cover(input[3], n_bins);
      // Caffe's pooling rejects it, too. This also bounds the height of the pyramid.
      if (pad_h >= kernel_h || pad_w >= kernel_w)
        throw InputError("level ", level, " of the pyramid has ", n_bins, " x ", n_bins,
                         " bins, too many for an input of ", input[2], " x ", input[3]);
      caffe::PoolingParameter pooling;
      pooling.set_pool(param_.pool() == caffe::SPPParameter::MAX ? caffe::PoolingParameter::MAX
                                                                 : caffe::PoolingParameter::AVE);
      pooling.set_kernel_h(kernel_h), pooling.set_kernel_w(kernel_w);
      pooling.set_stride_h(kernel_h), pooling.set_stride_w(kernel_w);
      pooling.set_pad_h(pad_h), pooling.set_pad_w(pad_w);
      levels.push_back(PoolingWindow(pooling).problem(input));
    }
    return levels;
  }

  caffe::SPPParameter param_;
};

}  // namespace

constinit const LayerEntries kPoolingLayers = {
    {"Pooling", make<Pooling, &Parameters::pooling_param>, "Caffe",
     "maximum (with mask), average, global"},
    {"SPP", make<Spp, &Parameters::spp_param>, "Caffe", "spatial pyramid pooling"},
};

}  // namespace revisit::engine
