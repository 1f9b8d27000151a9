#include "layer.h"

#include <limits>

namespace revisit::engine {

std::vector<Shape> OneToOneLayer::infer(const std::vector<Shape>& inputs, size_t n_outputs) const {
  expect_count(inputs.size(), 1, "inputs");
  expect_count(n_outputs, 1, "outputs");
  return {output_shape(inputs[0])};
}

bool is_for_training(const caffe::LayerParameter& param) {
  return param.has_phase() && param.phase() == caffe::TRAIN;
}

void expect_count(size_t found, size_t expected, const char* what) {
  if (found != expected) throw InputError("expected ", expected, " ", what, ", found ", found);
}

void expect_image(const Shape& input, const char* what) {
  if (input.rank() != 4)
    throw InputError(what, " needs an input of 4 axes (n x c x h x w), found ", input);
}

void expect_channels(const Shape& input, const char* what) {
  if (input.rank() < 2) throw InputError(what, " needs an input of at least 2 axes, found ", input);
}

void expect_int(int64_t size, const char* what) {
  constexpr int64_t kMost = std::numeric_limits<int>::max();
  if (size > kMost) throw InputError(what, " must be at most ", kMost, ", found ", size);
}

std::optional<WindowHw> window_across(size_t axis, const Shape& input) {
  return axis + 2 < input.rank() ? std::optional(WindowHw{}) : std::nullopt;
}

}  // namespace revisit::engine
