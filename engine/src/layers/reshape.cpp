#include <set>

#include "layers/layers.h"

namespace revisit::engine {
namespace {

template <class Base>
class ViewLayer : public Base {
 public:
  OutputMemory output_memory() const override { return OutputMemory::kViewOfInput; }
  bool allows_in_place() const override { return false; }
  Kernel bind(const Binding&) const override { return {}; }
};
using ReshapingLayer = ViewLayer<OneToOneLayer>;

/// Merges the axes [axis, end_axis]; if end_axis is directly before axis, adds an axis of size 1.
class Flatten : public ReshapingLayer {
 public:
  explicit Flatten(const caffe::FlattenParameter& param) : param_(param) {}

  Shape output_shape(const Shape& input) const override {
    const size_t first = input.canonical_axis(param_.axis(), "flatten axis");
    const size_t last = input.canonical_axis(param_.end_axis(), "flatten end_axis");
    if (last + 1 < first) throw InputError("end_axis ", last, " comes before axis ", first);
    std::vector<int64_t> axes(input.axes().begin(),
                              input.axes().begin() + static_cast<int64_t>(first));
    axes.push_back(input.product(first, last + 1));
    axes.insert(axes.end(), input.axes().begin() + static_cast<int64_t>(last) + 1,
                input.axes().end());
    return Shape(std::move(axes));
  }

 private:
  caffe::FlattenParameter param_;
};

/// Replaces axes [axis, axis + num_axes) by `shape`; 0 copies the input's axis, -1 is inferred.
class Reshape : public ReshapingLayer {
 public:
  explicit Reshape(const caffe::ReshapeParameter& param) : param_(param) {
    int inferred = 0;
    for (const int64_t size : param.shape().dim()) {
      if (size < -1) throw InputError("a dim must be -1, 0 or a size, found ", size);
      inferred += size == -1;
    }
    if (inferred > 1) throw InputError("at most one dim can be -1, found ", inferred);
    if (param.num_axes() < -1)
      throw InputError("num_axes must be -1 (all) or more, found ", param.num_axes());
  }

  Shape output_shape(const Shape& input) const override {
    const std::vector<int64_t>& old = input.axes();
    const auto rank = static_cast<int64_t>(input.rank());
    // Here -1 is the position after the last axis, not the last axis.
    const int64_t first = param_.axis() >= 0 ? param_.axis() : rank + param_.axis() + 1;
    if (first < 0 || first > rank)
      throw InputError("axis ", param_.axis(), " is out of range for an input of shape ", input);
    const int64_t last = param_.num_axes() == -1 ? rank : first + param_.num_axes();
    if (last > rank)
      throw InputError(param_.num_axes(), " axes from axis ", first, " on reach past the input (",
                       input, ")");

    std::vector<int64_t> axes(old.begin(), old.begin() + first);
    size_t inferred = old.size() + static_cast<size_t>(param_.shape().dim_size());  // none
    for (const int64_t size : param_.shape().dim()) {
      if (size == 0 && axes.size() >= old.size())
        throw InputError("dim ", axes.size() - static_cast<size_t>(first),
                         " is 0, but there is no such axis in the input (", input, ")");
      if (size == -1) inferred = axes.size();
      axes.push_back(size == 0 ? old[axes.size()] : size == -1 ? 1 : size);
    }
    axes.insert(axes.end(), old.begin() + last, old.end());

    Shape output{std::move(axes)};
    if (inferred < output.rank() && input.elements() % output.elements() == 0)
      output = output.with(inferred, input.elements() / output.elements());
    if (output.elements() != input.elements())
      throw InputError("the ", input.elements(), " values of the input (", input,
                       ") do not fit into the new shape (", output, ")");
    return output;
  }

 private:
  caffe::ReshapeParameter param_;
};

/// Removes axes of size 1: the given ones, or all.
class Squeeze : public ReshapingLayer {
 public:
  explicit Squeeze(const caffe::SqueezeParameter& param) : param_(param) {}

  Shape output_shape(const Shape& input) const override {
    std::set<size_t> removed;
    for (const int axis : param_.axis()) {
      const size_t at = input.canonical_axis(axis, "squeeze axis");
      if (input[at] != 1)
        throw InputError("axis ", axis, " of the input (", input, ") must have size 1");
      removed.insert(at);
    }
    std::vector<int64_t> axes;
    for (size_t i = 0; i < input.rank(); ++i)
      if (param_.axis().empty() ? input[i] != 1 : !removed.contains(i)) axes.push_back(input[i]);
    return Shape(std::move(axes));
  }

 private:
  caffe::SqueezeParameter param_;
};

class Identity : public ViewLayer<Layer> {
 public:
  explicit Identity(const caffe::LayerParameter& param) : is_split_(param.type() == "Split") {
    if (!is_split_ && is_for_training(param))
      throw UnsupportedError("`phase: TRAIN` on a Dropout layer drops values at random: remove it");
  }

  std::vector<Shape> infer(const std::vector<Shape>& inputs, size_t n_outputs) const override {
    expect_count(inputs.size(), 1, "inputs");
    expect_any(n_outputs, "output");
    return std::vector<Shape>(n_outputs, inputs[0]);
  }
  std::optional<WindowHw> window(const Shape&) const override { return WindowHw{}; }
  bool allows_in_place() const override { return !is_split_; }

 private:
  bool is_split_;
};

class ReshapedLike : public ViewLayer<Layer> {
 public:
  std::vector<Shape> infer(const std::vector<Shape>& inputs, size_t) const override {
    return {inputs.at(1)};
  }
  std::optional<WindowHw> window(const Shape&) const override { return WindowHw{}; }
};

/// Uses its inputs, so that they are not outputs of the net.
class Silence : public ViewLayer<Layer> {
 public:
  std::vector<Shape> infer(const std::vector<Shape>& inputs, size_t n_outputs) const override {
    expect_any(inputs.size(), "input");
    expect_count(n_outputs, 0, "outputs");
    return {};
  }
};

}  // namespace

std::unique_ptr<Layer> make_identity(const caffe::LayerParameter& param) {
  return std::make_unique<Identity>(param);
}

std::unique_ptr<Layer> make_reshaped_like() {
  return std::make_unique<ReshapedLike>();
}

constinit const LayerEntries kReshapeLayers = {
    {"Flatten", make<Flatten, &Parameters::flatten_param>, "Caffe", "merges axes"},
    {"Reshape", make<Reshape, &Parameters::reshape_param>, "Caffe", "changes the shape"},
    {"Silence", make<Silence>, "Caffe", "discards its inputs"},
    {"Split", make_identity, "Caffe", "copies of the input"},
    {"Squeeze", make<Squeeze, &Parameters::squeeze_param>, "Synopsys", "removes axes of size 1"},
};

}  // namespace revisit::engine
