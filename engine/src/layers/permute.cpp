#include <algorithm>

#include "layers/layers.h"

namespace revisit::engine {
namespace {

/// Transposition: axis i of the output is axis order[i] of the input.
class Permute : public OneToOneLayer {
 public:
  explicit Permute(const caffe::PermuteParameter& param)
      : Permute({param.order().begin(), param.order().end()}, "order", false) {}
  /// Lists all axes (tianzhi0549/CTPN, transpose_layer.cpp).
  explicit Permute(const caffe::TransposeParameter& param)
      : Permute({param.dim().begin(), param.dim().end()}, "dim", true) {}

  Shape output_shape(const Shape& input) const override {
    if (names_all_ && (order_.size() != input.rank() || order_.empty()))
      throw InputError("dim must name each of the ", input.rank(), " axes of the input (", input,
                       "), found ", order_.size());
    for (const int64_t axis : order_)
      if (axis < 0 || axis >= static_cast<int64_t>(input.rank()))
        throw InputError(field_, " names axis ", axis, ", the input is ", input);
    std::vector<int64_t> axes;
    for (const size_t axis : whole_order(input.rank())) axes.push_back(input[axis]);
    return Shape(std::move(axes));
  }

  bool keeps_items(size_t, const std::vector<Shape>&) const override {
    return order_.empty() || order_[0] == 0;
  }

  Rounding rounding() const override { return Rounding::kNone; }

  Kernel bind(const Binding& binding) const override {
    const Shape& input = binding.inputs[0];
    StridedCopyProblem copy{{1}, {0}, 0, binding.threads};  // a leading axis, for scalars
    for (const size_t axis : whole_order(input.rank())) {
      copy.shape.push_back(input[axis]);
      copy.strides.push_back(input.product(axis + 1, input.rank()));
    }
    return copy_kernel("transpose", std::move(copy));
  }

 private:
  /// `field` is the name of `order` in the file.
  Permute(std::vector<int64_t> order, const char* field, bool names_all)
      : order_(std::move(order)), field_(field), names_all_(names_all) {
    std::vector<int64_t> sorted = order_;
    std::sort(sorted.begin(), sorted.end());
    const auto twice = std::adjacent_find(sorted.begin(), sorted.end());
    if (twice != sorted.end()) throw InputError(field_, " names axis ", *twice, " twice");
  }

  std::vector<size_t> whole_order(size_t rank) const {
    std::vector<size_t> order(order_.begin(), order_.end());
    for (size_t axis = 0; axis < rank; ++axis)
      if (std::find(order_.begin(), order_.end(), axis) == order_.end()) order.push_back(axis);
    return order;
  }

  std::vector<int64_t> order_;
  const char* field_;
  bool names_all_;
};

/// Transposes channels [group][channel of the group] (layer of the ShuffleNet fork).
class ShuffleChannel : public OneToOneLayer {
 public:
  explicit ShuffleChannel(const caffe::ShuffleChannelParameter& param) : groups_(param.group()) {
    if (groups_ < 1) throw InputError("group must be at least 1");
  }

  Shape output_shape(const Shape& input) const override {
    expect_channels(input, "ShuffleChannel");
    if (input[1] % groups_ != 0)
      throw InputError("the ", input[1], " channels of the input (", input,
                       ") are not a multiple of group ", groups_);
    return input;
  }

  bool keeps_items(size_t, const std::vector<Shape>&) const override { return true; }

  std::optional<WindowHw> window(const Shape&) const override { return WindowHw{}; }

  Form form(const std::vector<Shape>& inputs, const std::vector<Tensor>&) const override {
    Shuffling shuffling;
    for (int64_t c = 0; c < inputs[0][1]; ++c)
      shuffling.sources.push_back(c % groups_ * (inputs[0][1] / groups_) + c / groups_);
    return shuffling;
  }

  Kernel bind(const Binding& binding) const override {
    const Shape& input = binding.inputs[0];
    const int64_t inner = input.product(2, input.rank()), per_group = input[1] / groups_;
    return copy_kernel("transpose", {{input[0], per_group, groups_, inner},
                                     {input[1] * inner, inner, per_group * inner, 1},
                                     0,
                                     binding.threads});
  }

 private:
  int64_t groups_;
};

/// Darknet's layer, as in eric612/MobileNet-YOLO and choasup/caffe-yolo9000, reorg_layer.cpp:
///   reverse:   `[n][s][s][c][h][w]` -> `[n][c][h][s][w][s]`
///   otherwise: `[n][c][h][s][w][s]` -> `[n][s][s][c][h][w]`, where the s^2 c channels, h and w are
///   those of the input, not of the output, so that pixels of several channels and rows mix.
/// Synopsys' fork (foss-for-synopsys-dwc-arc-processors/synopsys-caffe) swaps rows and columns. Its
/// DepthToSpace is the reverse in NCHW; CRD, the pixelshuffler of its Reshape, is
/// `[n][c][s][s][h][w]` -> `[n][c][h][s][w][s]`.
class Reorg : public OneToOneLayer {
 public:
  explicit Reorg(const caffe::ReorgParameter& param)
      : Reorg("stride", param.stride(), param.reverse()) {}
  explicit Reorg(const caffe::DepthToSpaceParameter& param)
      : Reorg("block_size", param.block_size(), true, param.data_format() == "CRD") {
    const std::string& format = param.data_format();
    if (format != "NCHW" && format != "DCR" && format != "CRD")
      throw UnsupportedError("data_format '", format, "' is not supported (NCHW, DCR or CRD)");
  }
  Reorg(const char* field, int64_t stride, bool reverse, bool channels_first = false)
      : field_(field), stride_(stride), reverse_(reverse), channels_first_(channels_first) {
    if (stride_ < 1) throw InputError(field_, " must be at least 1");
  }

  Shape output_shape(const Shape& input) const override {
    expect_image(input, "Reorg");
    const int64_t s = stride_, channels = input[1];
    // The original divides by zero, or mixes images.
    if (channels % s != 0 || channels / s % s != 0)
      throw InputError("the channels of the input (", input,
                       ") must be a multiple of the square of ", field_, " ", s, ", found ",
                       channels);
    if (reverse_) return {input[0], channels / s / s, input[2] * s, input[3] * s};
    if (input[2] % s != 0 || input[3] % s != 0)
      throw InputError("the rows and columns of the input (", input, ") must be multiples of ",
                       field_, " ", s, ", found ", input[2], " and ", input[3]);
    return {input[0], channels * s * s, input[2] / s, input[3] / s};
  }

  Rounding rounding() const override { return Rounding::kNone; }

  Kernel bind(const Binding& binding) const override {
    const Shape& input = binding.inputs[0];
    const int64_t s = stride_, n = input[0], h = input[2], w = input[3], c = input[1] / (s * s);
    const int64_t image = input.product(1, 4);
    const std::vector<int64_t> from{image, w * s, 1, s * w * h * s, s * w * s, s},
        grouped{image, s * s * h * w, w, s * h * w, 1, h * w},
        apart{image, h * w, w, s * c * h * w, 1, c * h * w};
    const auto& back = channels_first_ ? grouped : apart;
    const auto shape = reverse_ ? std::vector{n, c, h, s, w, s} : std::vector{n, s, s, c, h, w};
    return copy_kernel("reorganize", {shape, reverse_ ? back : from, 0, binding.threads});
  }

 private:
  const char* field_;
  int64_t stride_;
  bool reverse_, channels_first_;
};

/// Reverse: tianzhi0549/CTPN, reverse_layer.cpp: one axis, by default 0. Synopsys' fork
/// (foss-for-synopsys-dwc-arc-processors/synopsys-caffe) has several axes, which may be negative.
/// Without axes it is the identity, which cannot be distinguished from CTPN's default.
/// Flip: happynear/caffe-windows, flip_layer.cpp: mirrors images. Missing axes count as size 1.
class Reverse : public OneToOneLayer {
 public:
  explicit Reverse(const caffe::ReverseParameter& param)
      : axes_(param.axis().begin(), param.axis().end()) {
    if (axes_.empty()) axes_ = {0};
  }
  explicit Reverse(const caffe::FlipParameter& param) : flips_(true) {
    if (param.flip_height()) axes_.push_back(2);
    if (param.flip_width()) axes_.push_back(3);
  }

  Shape output_shape(const Shape& input) const override {
    reversed(input);
    return input;
  }

  std::optional<WindowHw> window(const Shape& input) const override {
    const std::vector<bool> axes = reversed(input);
    for (size_t axis = 0; axis < axes.size(); ++axis)
      if (axes[axis] && !window_across(axis, input)) return std::nullopt;
    return WindowHw{};
  }

  Rounding rounding() const override { return Rounding::kNone; }

  Form form(const std::vector<Shape>& inputs, const std::vector<Tensor>&) const override {
    const std::vector<bool> axes = reversed(inputs[0]);
    if (axes.size() < 2 || !axes[1] || std::count(axes.begin(), axes.end(), true) != 1) return {};
    Shuffling shuffling;
    for (int64_t c = inputs[0][1]; c > 0; --c) shuffling.sources.push_back(c - 1);
    return shuffling;
  }

  Kernel bind(const Binding& binding) const override {
    const Shape& input = binding.inputs[0];
    const std::vector<bool> axes = reversed(input);
    StridedCopyProblem copy{{1}, {0}, 0, binding.threads};  // a leading axis, for scalars
    for (size_t axis = 0; axis < axes.size(); ++axis) {
      const int64_t stride = input.product(axis + 1, input.rank());
      if (axes[axis]) copy.offset += (input[axis] - 1) * stride;
      if (axis == 0 || axes[axis] != axes[axis - 1]) {
        copy.shape.push_back(1);
        copy.strides.push_back(0);
      }
      copy.shape.back() *= input[axis];  // merges adjacent axes with the same direction
      copy.strides.back() = axes[axis] ? -stride : stride;
    }
    return copy_kernel("reverse", std::move(copy));
  }

 private:
  /// Returns for each axis of the input whether it is reversed. Throws InputError for invalid axes.
  std::vector<bool> reversed(const Shape& input) const {
    if (flips_ && input.rank() > 4)
      throw InputError("Flip needs an input of at most 4 axes (n x c x h x w), found ", input);
    std::vector<bool> result(input.rank());
    for (const int32_t named : axes_) {
      if (flips_ && named >= static_cast<int32_t>(input.rank())) continue;
      const size_t axis = input.canonical_axis(named, "reverse axis");
      if (result[axis])
        throw InputError("axis ", axis, " of the input (", input, ") is named twice");
      result[axis] = true;
    }
    return result;
  }

  std::vector<int32_t> axes_;
  bool flips_ = false;
};

}  // namespace

constinit const LayerEntries kPermuteLayers = {
    {"DepthToSpace", make<Reorg, &Parameters::depth_to_space_param>, "Synopsys",
     "moves channels to pixels of blocks"},
    {"Flip", make<Reverse, &Parameters::flip_param>, "caffe-windows", "mirrors images"},
    {"Permute", make<Permute, &Parameters::permute_param>, "SSD", "reorders axes"},
    {"Reorg", make<Reorg, &Parameters::reorg_param>, "YOLOv2",
     "moves pixels of blocks to channels, or back", !kTrained,
     "as in Darknet and MobileNet-YOLO; the Reorg of Synopsys' fork swaps rows and columns"},
    {"Reverse", make<Reverse, &Parameters::reverse_param>, "CTPN, Caffe OCR",
     "reverses the order along axes"},
    {"ShuffleChannel", make<ShuffleChannel, &Parameters::shuffle_channel_param>, "ShuffleNet",
     "interleaves groups of channels"},
    {"Transpose", make<Permute, &Parameters::transpose_param>, "CTPN, Caffe OCR", "reorders axes"},
};

}  // namespace revisit::engine
