#include "counting_new.h"
#include "revisit/engine/net.h"
#include "testing.h"

namespace revisit::engine {
namespace {

struct NamedNet {
  const char* name;
  const char* layers;  // they read data [2][6][12][12], rows [4][5], cont [4][5]
};

constexpr NamedNet kNets[] = {
    {"convolutions", R"(
      layer { name: "a" type: "Convolution" bottom: "data" top: "a" convolution_param { num_output: 4 kernel_size: 3 pad: 1 } }
      layer { name: "b" type: "Deconvolution" bottom: "a" top: "b" convolution_param { num_output: 3 kernel_size: 4 stride: 2 } }
      layer { name: "c" type: "Im2col" bottom: "a" top: "c" convolution_param { kernel_size: 2 } }
      layer { name: "d" type: "Convolution" bottom: "data" top: "d" convolution_param { num_output: 4 kernel_size: 3 axis: 0 } }
      layer { name: "e" type: "ConvolutionDepthwise" bottom: "a" top: "e" convolution_param { kernel_size: 3 } })"},
    {"pooling", R"(
      layer { name: "a" type: "Pooling" bottom: "data" top: "a" top: "mask" pooling_param { kernel_size: 2 stride: 2 ceil_mode: false } }
      layer { name: "b" type: "Upsample" bottom: "a" bottom: "mask" top: "b" upsample_param { scale: 2 } }
      layer { name: "c" type: "SPP" bottom: "data" top: "c" spp_param { pyramid_height: 3 } }
      layer { name: "d" type: "ROIPooling" bottom: "data" bottom: "rows" top: "d" roi_pooling_param { pooled_h: 2 pooled_w: 2 } }
      layer { name: "e" type: "Interp" bottom: "b" top: "e" interp_param { zoom_factor: 2 } }
      layer { name: "f" type: "LRN" bottom: "e" top: "f" }
      layer { name: "g" type: "Normalize" bottom: "e" top: "g" norm_param { across_spatial: false } })"},
    {"moving", R"(
      layer { name: "a" type: "Convolution" bottom: "data" top: "a" convolution_param { num_output: 4 kernel_size: 1 } }
      layer { name: "b" type: "Reorg" bottom: "a" top: "b" }
      layer { name: "c" type: "Reverse" bottom: "a" top: "c" reverse_param { axis: 1 } }
      layer { name: "d" type: "Flip" bottom: "b" top: "d" }
      layer { name: "e" type: "Transpose" bottom: "c" top: "e" transpose_param { dim: 3 dim: 2 dim: 1 dim: 0 } })"},
    {"sequences", R"(
      layer { name: "a" type: "LSTM" bottom: "data" bottom: "two" top: "a" recurrent_param { num_output: 3 } }
      layer { name: "b" type: "RNN" bottom: "data" bottom: "two" top: "b" recurrent_param { num_output: 3 } }
      layer { name: "c" type: "InnerProduct" bottom: "a" top: "c" inner_product_param { num_output: 3 } }
      layer { name: "f" type: "Lstm" bottom: "data" top: "f" lstm_param { num_output: 3 } }
      layer { name: "g" type: "Lstm" bottom: "rows" bottom: "keep" top: "g" lstm_param { num_output: 3 batch_size: 2 } }
      layer { name: "d" type: "Softmax" bottom: "c" top: "d" }
      layer { name: "e" type: "Filter" bottom: "rows" bottom: "keep" top: "e" })"},
    {"regions", R"(
      layer { name: "more" type: "Input" top: "scores" top: "offsets" top: "image" input_param {
        shape { dim: 1 dim: 4 dim: 3 dim: 3 } shape { dim: 1 dim: 8 dim: 3 dim: 3 } shape { dim: 1 dim: 3 } } }
      layer { name: "a" type: "Proposal" bottom: "scores" bottom: "offsets" bottom: "image" top: "a" proposal_param { ratio: 1 scale: 1 scale: 2 } }
      layer { name: "b" type: "PSROIPooling" bottom: "data" bottom: "a" top: "b" psroi_pooling_param { spatial_scale: 1 output_dim: 6 group_size: 1 } }
      layer { name: "c" type: "InnerProduct" bottom: "b" top: "c" inner_product_param { num_output: 3 } })"},
    {"detector", R"(
      layer { name: "a" type: "PriorBox" bottom: "data" bottom: "data" top: "a" prior_box_param { min_size: 3 max_size: 5 aspect_ratio: 2 } }
      layer { name: "b" type: "Convolution" bottom: "data" top: "b" convolution_param { num_output: 16 kernel_size: 1 } }
      layer { name: "c" type: "Flatten" bottom: "b" top: "c" }
      layer { name: "d" type: "Convolution" bottom: "data" top: "d" convolution_param { num_output: 12 kernel_size: 1 } }
      layer { name: "e" type: "Flatten" bottom: "d" top: "e" }
      layer { name: "f" type: "DetectionOutput" bottom: "c" bottom: "e" bottom: "a" top: "f" detection_output_param { num_classes: 3 keep_top_k: 50 } })"},
    {"proposals", R"(
      layer { name: "a" type: "Slice" bottom: "data" top: "a" top: "a2" slice_param { axis: 0 } }
      layer { name: "b" type: "Slice" bottom: "a2" top: "b" top: "b2" slice_param { slice_point: 2 } }
      layer { name: "c" type: "Yolov3DetectionOutput" bottom: "a" top: "c" yolov3_detection_output_param { num_classes: 1 num_box: 1 mask: 0 mask_group_num: 1 anchors_scale: 8 biases: [8, 8] } }
      layer { name: "d" type: "YoloDetectionOutput" bottom: "a" top: "d" yolo_detection_output_param { num_classes: 1 num_box: 1 biases: [1, 1] } }
      layer { name: "e" type: "BoxOutput" bottom: "data" top: "e" top: "e2" box_output_param { field_w: 20 field_h: 20 downsample_rate: 8 } }
      layer { name: "f" type: "BoxGroupOutput" bottom: "b" bottom: "b2" top: "f" box_group_output_param { box_group_param { field_w: 20 field_h: 20 stride: 8 } } }
      layer { name: "g" type: "Slice" bottom: "two" top: "g" top: "g2" slice_param { axis: 1 slice_point: 5 } }
      layer { name: "h" type: "Tile" bottom: "g" top: "h" tile_param { axis: 1 tiles: 8 } }
      layer { name: "i" type: "Reshape" bottom: "h" top: "i" reshape_param { shape { dim: -1 dim: 8 } } }
      layer { name: "j" type: "Tile" bottom: "g" top: "j" tile_param { axis: 0 tiles: 5 } }
      layer { name: "k" type: "DecodeBBox" bottom: "i" bottom: "j" top: "k" })"},
};

class Allocation : public testing::TestWithParam<NamedNet> {};

TEST_P(Allocation, NoneInAForwardPass) {
#ifdef __SANITIZE_ADDRESS__
  GTEST_SKIP() << "the address sanitizer counts its own allocations; the plain build runs this";
#endif
  const TempDir dir;
  write_file(dir / "net.prototxt", std::string(R"(
    layer { name: "in" type: "Input" top: "data" top: "rows" top: "keep" top: "two" input_param {
      shape { dim: 2 dim: 6 dim: 12 dim: 12 } shape { dim: 4 dim: 5 } shape { dim: 4 } shape { dim: 2 dim: 6 } } }
  )") + GetParam().layers);
  const Net net = Net::load_with_random_weights(dir / "net.prototxt", 1);
  engine::Run run(net.plan());
  for (const Port& port : net.inputs()) {
    const View<float> input = run.input(port.name);
    for (size_t i = 0; i < input.values().size(); ++i)
      input.data[i] = static_cast<float>(i * 7919 % 13) / 13 * 2 - 1;
  }
  run.forward();  // libraries may allocate on first use
  const int64_t before = test::allocations;
  ASSERT_GT(before, 0);
  run.forward();
  EXPECT_EQ(test::allocations - before, 0);
}

INSTANTIATE_TEST_SUITE_P(Nets, Allocation, testing::ValuesIn(kNets),
                         [](const auto& instance) { return std::string(instance.param.name); });

}  // namespace
}  // namespace revisit::engine
