#include <algorithm>
#include <cmath>

#include "layers/box_offsets.h"
#include "layers/layers.h"

namespace revisit::engine {

namespace {

/// Regions for the next stage of Cascade R-CNN (zhaoweicai/cascade-rcnn,
/// src/caffe/layers/decode_bbox_layer.cpp): regions `[rows][image, x1, y1, x2, y2]` moved by the
/// offsets of the foreground, the second half of `[rows][8]`. Regions include both ends.
void decode_regions(const BoxOffsets& offsets, int64_t rows, const float* numbers,
                    const float* regions, float* output) {
  for (int64_t i = 0; i < rows; ++i, numbers += 8, regions += 5, output += 5) {
    const float w = regions[3] - regions[1] + 1, h = regions[4] - regions[2] + 1;
    const auto t = [&](size_t k) { return offsets.apply(k, numbers[4 + k]); };
    const float new_w = w * std::exp(t(2)), new_h = h * std::exp(t(3));
    const float x = t(0) * w + 0.5F * (regions[3] + regions[1]) - (new_w - 1) / 2;
    const float y = t(1) * h + 0.5F * (regions[4] + regions[2]) - (new_h - 1) / 2;
    const float row[] = {regions[0], x, y, x + new_w - 1, y + new_h - 1};
    std::copy(std::begin(row), std::end(row), output);
  }
}

class DecodeBBox : public Layer {
 public:
  explicit DecodeBBox(const caffe::LayerParameter& param) : offsets_(param.bbox_reg_param()) {
    if (is_for_training(param))
      throw UnsupportedError(
          "`phase: TRAIN` on a DecodeBBox layer drops regions by the ground truth: remove it");
  }

  std::vector<Shape> infer(const std::vector<Shape>& inputs, size_t n_outputs) const override {
    expect_count(inputs.size(), 2, "inputs (offsets and regions; a third is for training)");
    expect_count(n_outputs, 1, "outputs");
    const Shape &offsets = inputs[0], &regions = inputs[1];
    const auto is_rows_of = [](const Shape& shape, int64_t numbers) {
      return shape.rank() >= 2 && shape[1] == numbers && shape.product(2, shape.rank()) == 1;
    };
    if (!is_rows_of(offsets, 8) || !is_rows_of(regions, 5) || offsets[0] != regions[0])
      throw InputError(
          "expected 8 offsets and 5 numbers (image, x1, y1, x2, y2) for each region, found ",
          offsets, " and ", regions);
    return {Shape{regions[0], 5, 1, 1}};
  }

  bool keeps_items(size_t, const std::vector<Shape>&) const override { return true; }

  Kernel bind(const Binding& binding) const override {
    return {"decode-regions", [offsets = offsets_, rows = binding.inputs[0][0]](const Call& call) {
              decode_regions(offsets, rows, call.inputs[0], call.inputs[1], call.outputs[0]);
            }};
  }

 private:
  BoxOffsets offsets_;
};

}  // namespace

std::unique_ptr<Layer> make_decode_bbox(const caffe::LayerParameter& param) {
  return std::make_unique<DecodeBBox>(param);
}

}  // namespace revisit::engine
