#include "layers/join_and_cut.h"
#include "layers/layers.h"

namespace revisit::engine {
namespace {

/// Darknet's layer, as in eric612/MobileNet-YOLO and choasup/caffe-yolo9000, reorg_layer.cpp:
///   reverse:   `[n][s][s][c][h][w]` -> `[n][c][h][s][w][s]`
///   otherwise: `[n][c][h][s][w][s]` -> `[n][s][s][c][h][w]`, where the s^2 c channels, h and w are
///   those of the input, not of the output, so that pixels of several channels and rows mix.
/// Synopsys' fork (foss-for-synopsys-dwc-arc-processors/synopsys-caffe) swaps rows and columns.
class Reorg : public OneToOneLayer {
 public:
  explicit Reorg(const caffe::ReorgParameter& param)
      : stride_(param.stride()), reverse_(param.reverse()) {
    if (stride_ < 1) throw InputError("stride must be at least 1");
  }

  Shape output_shape(const Shape& input) const override {
    expect_image(input, "Reorg");
    const int64_t s = stride_, channels = input[1];
    // The original divides by zero, or mixes images.
    if (channels % s != 0 || channels / s % s != 0)
      throw InputError("the channels of the input (", input,
                       ") must be a multiple of the square of ", "stride ", s, ", found ",
                       channels);
    if (reverse_) return {input[0], channels / s / s, input[2] * s, input[3] * s};
    if (input[2] % s != 0 || input[3] % s != 0)
      throw InputError("the rows and columns of the input (", input,
                       ") must be multiples of stride ", s, ", found ", input[2], " and ",
                       input[3]);
    return {input[0], channels * s * s, input[2] / s, input[3] / s};
  }

  Rounding rounding() const override { return Rounding::kNone; }

  Kernel bind(const Binding& binding) const override {
    const Shape& input = binding.inputs[0];
    const int64_t s = stride_, n = input[0], h = input[2], w = input[3], c = input[1] / (s * s);
    const int64_t image = input.product(1, 4);
    const std::vector<int64_t> from{image, w * s, 1, s * w * h * s, s * w * s, s},
        back{image, h * w, w, s * c * h * w, 1, c * h * w};
    const auto shape = reverse_ ? std::vector{n, c, h, s, w, s} : std::vector{n, s, s, c, h, w};
    return copy_kernel("reorganize", {shape, reverse_ ? back : from, 0, binding.threads});
  }

 private:
  int64_t stride_;
  bool reverse_;
};

}  // namespace

std::unique_ptr<Layer> make_reorg(const caffe::LayerParameter& param) {
  return std::make_unique<Reorg>(param.reorg_param());
}

}  // namespace revisit::engine
