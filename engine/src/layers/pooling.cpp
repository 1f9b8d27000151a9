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
  } else if (param.has_kernel_size() == has_hw && param.kernel_size_nd().empty()) {
    throw InputError("give kernel_size, or both kernel_h and kernel_w (and not both forms)");
  }
  if (param.has_pad() && (param.has_pad_h() || param.has_pad_w()))
    throw InputError("give pad, or pad_h and pad_w, not both");
  if (param.has_pad_h() != param.has_pad_w())
    throw InputError("pad_h and pad_w must be given together");
  ends_ = pad_ends(param);
  if (param.has_stride() && (param.has_stride_h() || param.has_stride_w()))
    throw InputError("give stride, or stride_h and stride_w, not both");
  if (param.has_stride_h() != param.has_stride_w())
    throw InputError("stride_h and stride_w must be given together");
  if (param.has_ceil_mode() && param.has_round_mode())
    throw InputError("give round_mode or ceil_mode, not both");
  if (param.pool() == caffe::PoolingParameter::STOCHASTIC)
    throw UnsupportedError("stochastic pooling is not supported (Caffe runs it on a GPU only)");
  for (size_t axis = 0; axis < 2; ++axis) window(axis, 2, !is_nd());
}

WindowAxes PoolingWindow::axes(const Shape& input) const {
  if (input.rank() != 4 && input.rank() != 5)
    throw InputError("pooling needs an input of 4 axes (n x c x h x w), or 5 for volumes, found ",
                     input);
  const size_t n = input.rank() - 2;
  if (ends_ && n != 2) throw InputError("pad_b and pad_r need 2 spatial axes, the input has ", n);
  WindowAxes axes;
  bool is_padded = false;
  for (size_t i = 0; i < n; ++i) {
    const Window w = param_.global_pooling() ? Window{input[i + 2], 1, 0} : window(i, n, true);
    is_padded |= w.pad > 0;
    axes.push_back({.image = input[i + 2], .kernel = w.extent, .stride = w.stride, .pad = w.pad});
    if (!ends_) continue;
    axes[i].end_surplus = (*ends_)[i] - w.pad;
    is_padded |= (*ends_)[i] > 0;
  }
  for (WindowAxis& axis : axes) axis.windows = size(axis, is_padded);
  return axes;
}

PoolingProblem PoolingWindow::problem(const Shape& input) const {
  const WindowAxes of = axes(input);
  const WindowAxis &h = of[of.size() - 2], &w = of.back();
  PoolingProblem p;
  p.planes = input[0] * input[1];
  if (of.size() == 3) p.depth = of[0];
  p.h = h.image, p.w = w.image;
  p.out_h = h.windows, p.out_w = w.windows;
  p.kernel_h = h.kernel, p.kernel_w = w.kernel;
  p.stride_h = h.stride, p.stride_w = w.stride;
  p.pad_h = h.pad, p.pad_w = w.pad;
  p.end_surplus_h = h.end_surplus, p.end_surplus_w = w.end_surplus;
  p.counts_padding = param_.pool() != caffe::PoolingParameter::AVE_EXC_PAD;
  return p;
}

std::optional<WindowHw> PoolingWindow::window(const Shape& input) const {
  if (param_.global_pooling()) return std::nullopt;
  const size_t n = input.rank() - 2;
  return WindowHw{window(n - 2, n, true), window(n - 1, n, true)};
}

Window PoolingWindow::window(size_t axis, size_t n_axes, bool checked) const {
  const auto of_axis = [&](const auto& each, bool has_hw, uint32_t h, uint32_t w, uint32_t all,
                           const char* what) -> int64_t {
    if (!each.empty() && checked && static_cast<size_t>(each.size()) != n_axes)
      throw InputError(what, " is given ", each.size(), " times; expected once, or once for each ",
                       "of ", n_axes, " spatial axes");
    if (!each.empty()) return each[std::min(static_cast<int>(axis), each.size() - 1)];
    if (!has_hw) return all;
    if (n_axes != 2)
      throw InputError(what, "_h and its _w need 2 spatial axes, the input has ", n_axes);
    return axis == 0 ? h : w;
  };
  const Window result{
      of_axis(param_.kernel_size_nd(), !param_.has_kernel_size() && !param_.global_pooling(),
              param_.kernel_h(), param_.kernel_w(), param_.kernel_size(), "kernel"),
      of_axis(param_.stride_nd(), param_.has_stride_h(), param_.stride_h(), param_.stride_w(),
              param_.stride(), "stride"),
      of_axis(param_.pad_nd(), param_.has_pad_h(), param_.pad_h(), param_.pad_w(), param_.pad(),
              "pad")};
  if (param_.global_pooling()) {
    if (result.stride != 1 || result.pad != 0 || (ends_ && *ends_ != std::array<int64_t, 2>{}))
      throw InputError("global pooling needs stride 1 and no pad");
    return result;
  }
  expect_int(result.extent, "the kernel size");
  expect_int(result.stride, "the stride");
  if (axis < 2 && ends_ && (*ends_)[axis] >= result.extent)
    throw InputError("pad_b and pad_r must be smaller than the kernel ", result.extent);
  if (result.extent < 1) throw InputError("the kernel size must be at least 1");
  if (result.stride < 1) throw InputError("the stride must be at least 1");
  if (result.pad >= result.extent)
    throw InputError("pad ", result.pad, " must be smaller than the kernel ", result.extent);
  return result;
}

/// docs/reference/LAYERS.md point 1. Computed in float, like in Caffe.
int64_t PoolingWindow::size(const WindowAxis& axis, bool is_padded) const {
  const bool floor = param_.has_ceil_mode() ? !param_.ceil_mode()
                                            : param_.round_mode() == caffe::PoolingParameter::FLOOR;
  const float steps =
      static_cast<float>(axis.padded() - axis.kernel) / static_cast<float>(axis.stride);
  int64_t out = static_cast<int64_t>(floor ? std::floor(steps) : std::ceil(steps)) + 1;
  // The last window must start inside the image or its leading pad, once any axis is padded.
  if (is_padded && (out - 1) * axis.stride >= axis.image + axis.pad) --out;
  if (out < 1)
    throw InputError("a kernel of ", axis.kernel, " does not fit into ", axis.image, " + ",
                     axis.padded() - axis.image, " of padding: the output would be empty");
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
    Shape output = inputs[0];
    for (size_t i = 0; const WindowAxis& axis : window_.axes(inputs[0]))
      output = output.with(2 + i++, axis.windows);
    return std::vector<Shape>(n_outputs, output);
  }

  std::optional<WindowHw> window(const Shape& input) const override {
    return window_.window(input);
  }

  bool keeps_items(size_t, const std::vector<Shape>&) const override { return true; }

  Rounding rounding() const override {
    return window_.is_max() ? Rounding::kNone : Rounding::kAveraged;
  }

  Form form(const std::vector<Shape>& inputs, const std::vector<Tensor>&) const override {
    if (inputs[0].rank() != 4) return {};
    const PoolingProblem problem = window_.problem(inputs[0]);
    return window_.is_max() ? Form(problem) : Form(Averaging{problem});
  }

  Kernel bind(const Binding& binding) const override {
    PoolingProblem problem = window_.problem(binding.inputs[0]);
    const bool is_image = binding.inputs[0].rank() == 4;
    const char* const volumes = is_image ? "" : "-volumes";
    problem.threads = binding.threads;
    if (is_image) problem.values = binding.precision;
    if (!window_.is_max())
      return {str("average-pool", volumes), [problem](const Call& call) {
                average_pool(problem, call.inputs[0], call.outputs[0]);
              }};
    return {str("max-pool", volumes), [problem](const Call& call) {
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

  /// Returns kernel and pad. Follows Caffe's rule: half of the missing pixels, rounded up.
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
     "maximum (with mask), average, global; of volumes, too"},
    {"SPP", make<Spp, &Parameters::spp_param>, "Caffe", "spatial pyramid pooling"},
};

}  // namespace revisit::engine
