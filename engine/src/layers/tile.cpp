#include "layers/join_and_cut.h"
#include "layers/layers.h"

namespace revisit::engine {
namespace {

class Tile : public OneToOneLayer {
 public:
  explicit Tile(const caffe::TileParameter& param) : param_(param) {
    if (param.tiles() < 1)
      throw InputError("tiles must be given and at least 1, found ", param.tiles());
  }

  Shape output_shape(const Shape& input) const override {
    const size_t axis = tile_axis(input);
    return input.with(axis, input[axis] * param_.tiles());
  }

  std::optional<WindowHw> window(const Shape& input) const override {
    return window_across(tile_axis(input), input);
  }

  Kernel bind(const Binding& binding) const override {
    const Shape& input = binding.inputs[0];
    const size_t axis = tile_axis(input);
    const int64_t run = input.product(axis, input.rank());
    return copy_kernel(
        "copy", {{input.product(0, axis), param_.tiles(), run}, {run, 0, 1}, 0, binding.threads});
  }

 private:
  size_t tile_axis(const Shape& input) const {
    return input.canonical_axis(param_.axis(), "tile axis");
  }

  caffe::TileParameter param_;
};

}  // namespace

std::unique_ptr<Layer> make_tile(const caffe::LayerParameter& param) {
  return std::make_unique<Tile>(param.tile_param());
}

}  // namespace revisit::engine
