
#include <algorithm>
#include <cstdlib>
#include <numeric>

#include "layers/layers.h"

namespace revisit::engine {

Kernel copy_kernel(const char* name, StridedCopyProblem copy) {
  return {name, [copy = std::move(copy)](const Call& call) {
            strided_copy(copy, call.inputs[0], call.outputs[0]);
          }};
}

Kernel join_kernel(int64_t outer, const std::vector<int64_t>& sizes) {
  Kernel kernel{"copy", [outer, sizes](const Call& call) {
                  float* out = call.outputs[0];
                  for (int64_t i = 0; i < outer; ++i)
                    for (size_t input = 0; input < sizes.size(); ++input)
                      out = std::copy_n(call.inputs[input] + i * sizes[input], sizes[input], out);
                }};
  if (outer == 1) kernel.aliasing = Aliasing::kJoinsInputs;
  return kernel;
}

Kernel cut_kernel(int64_t outer, const std::vector<int64_t>& sizes, int threads) {
  const int64_t whole = std::accumulate(sizes.begin(), sizes.end(), int64_t{0});
  std::vector<StridedCopyProblem> copies;
  int64_t offset = 0;
  for (const int64_t size : sizes) {
    copies.push_back({{outer, size}, {whole, 1}, offset, threads});
    offset += size;
  }
  Kernel kernel{"copy", [copies = std::move(copies)](const Call& call) {
                  for (size_t i = 0; i < copies.size(); ++i)
                    if (call.outputs[i] != call.inputs[0] + copies[i].offset)
                      strided_copy(copies[i], call.inputs[0], call.outputs[i]);
                }};
  if (outer == 1) kernel.aliasing = Aliasing::kCutsInput;
  return kernel;
}

namespace {

/// Darknet's max pooling with stride 1 keeps the size, and converters to Caffe do not write that.
std::string hint_for(const Shape& a, const Shape& b) {
  const bool is_near = a.rank() == 4 && b.rank() == 4 && a[2] != b[2] &&
                       std::max(std::abs(a[2] - b[2]), std::abs(a[3] - b[3])) == 2;
  return is_near ? "; if it is a YOLO net of Darknet, whose max pooling with kernel 2 and stride 1 "
                   "keeps the size, give that Pooling pad: 1 and a Crop behind it { axis: 2 "
                   "offset: 1 } to the size of its input"
                 : "";
}

/// Joins the inputs, or cuts the input into the outputs.
class AlongAxis : public Layer {
 public:
  std::optional<size_t> only_axis(const Shape& input) const override {
    return input.canonical_axis(axis_, joins_ ? "concat axis" : "slice axis");
  }

  Rounding rounding() const override { return Rounding::kNone; }

  Form form(const std::vector<Shape>& inputs, const std::vector<Tensor>&) const override {
    if (inputs[0].rank() != 4 || only_axis(inputs[0]) != 1U) return {};
    return joins_ ? Form(Joining{}) : Form(Cutting{});
  }

  Kernel bind(const Binding& binding) const override {
    const std::vector<Shape>& parts = joins_ ? binding.inputs : binding.outputs;
    const size_t axis = *only_axis(parts[0]);
    const int64_t outer = parts[0].product(0, axis);
    std::vector<int64_t> sizes;
    for (const Shape& part : parts) sizes.push_back(part.product(axis, part.rank()));
    Kernel kernel = joins_ ? join_kernel(outer, sizes) : cut_kernel(outer, sizes, binding.threads);
    if (binding.reference_kernels) kernel.aliasing = Aliasing::kNone;
    return kernel;
  }

 protected:
  AlongAxis(bool joins, int64_t axis) : joins_(joins), axis_(axis) {}

 private:
  bool joins_;
  int64_t axis_;
};

class Concat : public AlongAxis {
 public:
  explicit Concat(const caffe::ConcatParameter& param)
      : AlongAxis(true, param.has_concat_dim() ? int64_t{param.concat_dim()} : param.axis()) {
    if (param.has_axis() && param.has_concat_dim())
      throw InputError("give axis or concat_dim, not both");
  }

  std::vector<Shape> infer(const std::vector<Shape>& inputs, size_t n_outputs) const override {
    expect_any(inputs.size(), "input");
    expect_count(n_outputs, 1, "outputs");
    const size_t axis = *only_axis(inputs[0]);
    int64_t total = 0;
    for (const Shape& input : inputs) {
      if (input.rank() != inputs[0].rank() || input.with(axis, 1) != inputs[0].with(axis, 1))
        throw InputError("inputs must agree in all axes but ", axis, ", found ", inputs[0], " and ",
                         input, hint_for(inputs[0], input));
      total += input[axis];
    }
    return {inputs[0].with(axis, total)};
  }
};

class Slice : public AlongAxis {
 public:
  explicit Slice(const caffe::SliceParameter& param)
      : AlongAxis(false, param.has_slice_dim() ? int64_t{param.slice_dim()} : param.axis()),
        param_(param) {
    if (param.has_axis() && param.has_slice_dim())
      throw InputError("give axis or slice_dim, not both");
  }

  std::vector<Shape> infer(const std::vector<Shape>& inputs, size_t n_outputs) const override {
    expect_count(inputs.size(), 1, "inputs");
    expect_any(n_outputs, "output");
    const size_t axis = *only_axis(inputs[0]);
    const int64_t size = inputs[0][axis];
    std::vector<Shape> outputs;
    if (param_.slice_point_size() == 0) {
      const auto parts = static_cast<int64_t>(n_outputs);
      if (size % parts != 0)
        throw InputError("axis ", axis, " of the input (", inputs[0], ") cannot be cut into ",
                         parts, " equal parts; give slice_point");
      outputs.assign(n_outputs, inputs[0].with(axis, size / parts));
      return outputs;
    }
    if (static_cast<size_t>(param_.slice_point_size()) != n_outputs - 1)
      throw InputError("expected ", n_outputs - 1, " slice points for ", n_outputs,
                       " outputs, found ", param_.slice_point_size());
    int64_t begin = 0;
    for (size_t i = 0; i < n_outputs; ++i) {
      const int64_t end = i + 1 < n_outputs ? param_.slice_point(static_cast<int>(i)) : size;
      if (end <= begin || end > size)
        throw InputError("slice points must increase from above 0 to below ", size,
                         ", the size of axis ", axis, " of the input (", inputs[0], ")");
      outputs.push_back(inputs[0].with(axis, end - begin));
      begin = end;
    }
    return outputs;
  }

 private:
  caffe::SliceParameter param_;
};

Kernel cut_out(const std::vector<int64_t>& offsets, const Binding& binding) {
  const Shape& input = binding.inputs[0];
  StridedCopyProblem copy{binding.outputs[0].axes(), {}, 0, binding.threads};
  for (size_t axis = 0; axis < input.rank(); ++axis) {
    copy.strides.push_back(input.product(axis + 1, input.rank()));
    copy.offset += offsets[axis] * copy.strides.back();
  }
  return copy_kernel("copy", std::move(copy));
}

std::optional<WindowHw> window_at(const std::vector<int64_t>& offsets) {
  const size_t rank = offsets.size();
  if (rank < 2) return std::nullopt;
  return WindowHw{{1, 1, -offsets[rank - 2]}, {1, 1, -offsets[rank - 1]}};
}

class Crop : public Layer {
 public:
  explicit Crop(const caffe::CropParameter& param) : param_(param) {}

  std::vector<Shape> infer(const std::vector<Shape>& inputs, size_t n_outputs) const override {
    expect_count(inputs.size(), 2, "inputs");
    expect_count(n_outputs, 1, "outputs");
    const Shape &input = inputs[0], &wanted = inputs[1];
    const size_t first = first_axis(input);
    const auto n_offsets = static_cast<size_t>(param_.offset_size());
    if (n_offsets > 1 && first + n_offsets != input.rank())
      throw InputError("expected one offset, or one for each of the ", input.rank() - first,
                       " axes from axis ", first, " on, found ", n_offsets);
    if (wanted.rank() < input.rank())
      throw InputError("the second input (", wanted, ") has fewer axes than the first (", input,
                       ")");
    const std::vector<int64_t> offsets = offsets_in(input);
    std::vector<int64_t> axes = input.axes();
    for (size_t axis = first; axis < axes.size(); ++axis) {
      if (offsets[axis] + wanted[axis] > input[axis])
        throw InputError("in axis ", axis, ", ", wanted[axis], " values from ", offsets[axis],
                         " on reach past the input (", input, ")");
      axes[axis] = wanted[axis];
    }
    return {Shape(std::move(axes))};
  }

  std::optional<WindowHw> window(const Shape& input) const override {
    return window_at(offsets_in(input));
  }

  Rounding rounding() const override { return Rounding::kNone; }

  Kernel bind(const Binding& binding) const override {
    return cut_out(offsets_in(binding.inputs[0]), binding);
  }

 private:
  size_t first_axis(const Shape& input) const {
    return input.canonical_axis(param_.axis(), "crop axis");
  }

  std::vector<int64_t> offsets_in(const Shape& input) const {
    std::vector<int64_t> offsets(input.rank(), 0);
    const size_t first = first_axis(input);
    for (size_t axis = first; param_.offset_size() > 0 && axis < input.rank(); ++axis)
      offsets[axis] = param_.offset(param_.offset_size() == 1 ? 0 : static_cast<int>(axis - first));
    return offsets;
  }

  caffe::CropParameter param_;
};

class CropCenter : public OneToOneLayer {
 public:
  explicit CropCenter(const caffe::CropCenterParameter& param)
      : cut_(param.crop_size().begin(), param.crop_size().end()) {
    for (const int64_t size : cut_) expect_int(size, "crop_size");
  }

  Shape output_shape(const Shape& input) const override {
    if (cut_.size() != input.rank())
      throw InputError("expected a crop_size for each of the ", input.rank(),
                       " axes of the input (", input, "), found ", cut_.size());
    std::vector<int64_t> axes = input.axes();
    for (size_t axis = 0; axis < axes.size(); ++axis) {
      axes[axis] -= 2 * cut_[axis];
      if (axes[axis] < 1)
        throw InputError("in axis ", axis, ", cutting ", cut_[axis],
                         " values off both ends leaves nothing of the input (", input, ")");
    }
    return Shape(std::move(axes));
  }

  std::optional<WindowHw> window(const Shape&) const override { return window_at(cut_); }

  Kernel bind(const Binding& binding) const override { return cut_out(cut_, binding); }

 private:
  std::vector<int64_t> cut_;
};

/// A second input (alenaliu/PPR-FCN) has an item for each tile.
class Tile : public Layer {
 public:
  explicit Tile(const caffe::TileParameter& param) : param_(param) {}

  std::vector<Shape> infer(const std::vector<Shape>& inputs, size_t n_outputs) const override {
    expect_1_or_2(inputs.size(), "inputs");
    expect_count(n_outputs, 1, "outputs");
    const int64_t times = tiles(inputs);
    if (times < 1) throw InputError("tiles must be given and at least 1, found ", times);
    const size_t axis = *only_axis(inputs[0]);
    return {inputs[0].with(axis, inputs[0][axis] * times)};
  }

  std::optional<size_t> only_axis(const Shape& input) const override {
    return input.canonical_axis(param_.axis(), "tile axis");
  }

  bool keeps_items(size_t port, const std::vector<Shape>& inputs) const override {
    return port == 0 && only_axis(inputs[0]) > 0U;
  }

  Kernel bind(const Binding& binding) const override {
    const Shape& input = binding.inputs[0];
    const size_t axis = *only_axis(input);
    const int64_t run = input.product(axis, input.rank());
    return copy_kernel(
        "copy",
        {{input.product(0, axis), tiles(binding.inputs), run}, {run, 0, 1}, 0, binding.threads});
  }

 private:
  int64_t tiles(const std::vector<Shape>& inputs) const {
    return inputs.size() == 2 && inputs[1].rank() > 0 ? inputs[1][0] : param_.tiles();
  }

  caffe::TileParameter param_;
};

}  // namespace

constinit const LayerEntries kJoinAndCutLayers = {
    {"Concat", make<Concat, &Parameters::concat_param>, "Caffe", "joins along an axis"},
    {"Crop", make<Crop, &Parameters::crop_param>, "Caffe", "crops to the size of another blob"},
    {"CropCenter", make<CropCenter, &Parameters::crop_center_param>, "waifu2x-caffe",
     "crops both ends of axes"},
    {"Slice", make<Slice, &Parameters::slice_param>, "Caffe", "cuts along an axis"},
    {"Tile", make<Tile, &Parameters::tile_param>, "Caffe", "repeats along an axis"},
};

}  // namespace revisit::engine
