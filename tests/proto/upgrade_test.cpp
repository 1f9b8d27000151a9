// Rules: docs/reference/LAYERS.md point 7.
#include <google/protobuf/text_format.h>
#include <google/protobuf/util/message_differencer.h>

#include <cctype>

#include "revisit/proto/net_file.h"
#include "testing.h"

namespace revisit::proto {
namespace {

using google::protobuf::FieldDescriptor;
using google::protobuf::util::MessageDifferencer;

/// `wanted` is V2 text.
NetFile expect_upgrade(const std::string& text, const std::string& wanted) {
  caffe::NetParameter expected;
  EXPECT_TRUE(google::protobuf::TextFormat::ParseFromString(wanted, &expected));
  NetFile file = parse_net(text, "net", {.keep_training = true});
  MessageDifferencer differencer;
  std::string difference;
  differencer.ReportDifferencesToString(&difference);
  EXPECT_TRUE(differencer.Compare(expected, file.net)) << difference;
  return file;
}

std::string upgrade_error(const std::string& text) {
  return message_of<InputError>([&] { parse_net(text, "net"); });
}

TEST(UpgradeInputs, FourDimsPerInputBecomeAnInputLayerPlacedFirst) {
  expect_upgrade(R"(input: 'a' input: 'b'
                    input_dim: 1 input_dim: 2 input_dim: 3 input_dim: 4
                    input_dim: 5 input_dim: 6 input_dim: 7 input_dim: 8
                    layer { name: 'r' } layer { name: 's' })",
                 R"(layer { name: 'input' type: 'Input' top: 'a' top: 'b'
                      input_param { shape { dim: [1, 2, 3, 4] } shape { dim: [5, 6, 7, 8] } } }
                    layer { name: 'r' } layer { name: 's' })");
}

TEST(UpgradeInputs, InputShapeWinsOverInputDim) {
  const NetFile file = expect_upgrade(
      "input: 'a' input_dim: 1 input_dim: 2 input_dim: 3 input_dim: 4 input_shape { dim: 7 }",
      "layer { name: 'input' type: 'Input' top: 'a' input_param { shape { dim: 7 } } }");
  EXPECT_EQ(file.warnings,
            std::vector<std::string>{"net: input_dim is ignored, because input_shape is given"});
}

TEST(UpgradeInputs, InputWithoutDimsIsDropped) {
  const char* reader = "layer { name: 'r' type: 'ReLU' bottom: 'a' top: 'b' }";
  EXPECT_EQ(expect_upgrade(str("input: 'a' ", reader), reader).warnings.size(), 1U);
  const NetFile loaded = parse_net(str("input: 'a' ", reader), "net");
  EXPECT_TRUE(loaded.warnings.empty());
  ASSERT_EQ(loaded.net.layer_size(), 2);
  EXPECT_EQ(loaded.net.layer(0).type(), "Input");
  EXPECT_FALSE(loaded.net.layer(0).has_input_param());
  const std::string both =
      str("layer { name: 'd' type: 'Input' top: 'a' input_param { shape { } } }", reader);
  EXPECT_EQ(expect_upgrade("input: 'a' " + both, both).warnings.size(), 1U);
  EXPECT_EQ(expect_upgrade("input: 'a' layer { name: 'r' }", "layer { name: 'r' }").warnings.size(),
            1U);
  EXPECT_EQ(
      expect_upgrade("input_dim: 3 layer { name: 'r' }", "layer { name: 'r' }").warnings.size(),
      1U);
}

/// Guards against a quadratic search, which took minutes.
TEST(UpgradeInputs, ManyWithoutDimsAreQuick) {
  std::string text;
  for (int i = 0; i < 100'000; ++i) text += "input:'a'";
  for (int i = 0; i < 15'000; ++i) text += "layer{top:'b'bottom:'c'}";
  const std::clock_t begin = std::clock();  // CPU time, independent of other programs
  EXPECT_EQ(parse_net(text, "net").warnings.size(), 100'000U);
  EXPECT_LT((std::clock() - begin) / CLOCKS_PER_SEC, 4);
}

TEST(UpgradeInputs, OnlyThoseThatAreReadAndNotMadeAreKept) {
  const NetFile file = parse_net(
      "input: 'read' input: 'made' input: 'changed' input: 'read, then made' input: 'none'"
      "layer { name: 'm' type: 'DummyData' top: 'made' }"
      "layer { name: 'p' type: 'Power' bottom: 'changed' top: 'changed' }"
      "layer { name: 'q' type: 'Eltwise' bottom: 'read' bottom: 'made' bottom: 'read, then made' "
      "top: 'q' }"
      "layer { name: 'r' type: 'Power' bottom: 'q' top: 'read, then made' }",
      "net");
  const auto& kept = file.net.layer(0).top();
  EXPECT_EQ(std::vector<std::string>(kept.begin(), kept.end()),
            (std::vector<std::string>{"read", "changed"}));
  EXPECT_EQ(file.warnings.size(), 3U);
}

TEST(UpgradeInputs, StandsBesideAnInputLayerOfItsOwn) {
  expect_upgrade("input: 'a' input_shape { } layer { name: 'd' type: 'Input' top: 'd' }",
                 "layer { name: 'input' type: 'Input' top: 'a' input_param { shape { } } }"
                 "layer { name: 'd' type: 'Input' top: 'd' }");
}

TEST(UpgradeInputs, WrongCountsAreErrors) {
  EXPECT_EQ(upgrade_error("input: 'a'\n  input_dim: 1 input_dim: 2 input_dim: 3\nlayer { }"),
            "net:2:3: expected 4 input_dim for each of the 1 inputs, found 3");
  EXPECT_EQ(upgrade_error("input: 'a' input: 'b'\ninput_shape { dim: 1 }"),
            "net:2:1: expected one input_shape for each of the 2 inputs, found 1");
}

TEST(Upgrade, LayerAndLayersTogetherIsAnError) {
  EXPECT_TRUE(upgrade_error("layer { name: 'a' }\n layers { name: 'b' }")
                  .starts_with("net:2:2: has both V2 `layer"));
}

TEST(UpgradeBatchNorm, ExactlyThreeParamsLoseTheirRates) {
  expect_upgrade(
      "layer { type: 'BatchNorm' param { lr_mult: 1 } param { name: 'v' } param { decay_mult: 2 } "
      "}",
      "layer { type: 'BatchNorm' param { lr_mult: 0 decay_mult: 0 }"
      "  param { name: 'v' lr_mult: 0 decay_mult: 0 } param { lr_mult: 0 decay_mult: 0 } }");
  for (const char* untouched :
       {"layer { type: 'BatchNorm' param { lr_mult: 1 } param { } }",
        "layer { type: 'BatchNorm' param { } param { } param { } param { } }",
        "layer { type: 'Scale' param { } param { } param { } }"}) {
    expect_upgrade(untouched, untouched);
  }
}

TEST(UpgradeV1, EverythingALayerHas) {
  expect_upgrade(R"(name: 'n' force_backward: true state { phase: TRAIN }
                    layers { name: 'c' type: CONVOLUTION bottom: 'a' top: 'b' include { phase: TEST }
                             exclude { stage: 's' } loss_weight: 2 convolution_param { kernel_size: 3 }
                             transform_param { scale: 2 } blobs { num: 1 data: 5 } })",
                 R"(name: 'n' force_backward: true state { phase: TRAIN }
                    layer { name: 'c' type: 'Convolution' bottom: 'a' top: 'b' include { phase: TEST }
                            exclude { stage: 's' } loss_weight: 2 convolution_param { kernel_size: 3 }
                            transform_param { scale: 2 } blobs { num: 1 data: 5 } })");
}

TEST(UpgradeV1, SharingAndRatesBecomeParamSpecs) {
  expect_upgrade(R"(layers { param: 'w' blob_share_mode: STRICT blob_share_mode: PERMISSIVE
                             blobs_lr: 1 blobs_lr: 2 weight_decay: 3 weight_decay: 4 weight_decay: 5 })",
                 R"(layer { param { name: 'w' share_mode: STRICT lr_mult: 1 decay_mult: 3 }
                            param { share_mode: PERMISSIVE lr_mult: 2 decay_mult: 4 } param { decay_mult: 5 } })");
}

TEST(UpgradeV1, DataTransformMovesToTransformParam) {
  expect_upgrade(
      R"(layers { type: DATA data_param { source: 's' scale: 2 mean_file: 'm' crop_size: 3 mirror: true } }
                    layers { type: IMAGE_DATA image_data_param { crop_size: 4 } }
                    layers { type: WINDOW_DATA window_data_param { mirror: false } transform_param { scale: 5 } }
                    layers { type: HDF5_DATA data_param { scale: 6 } })",
      R"(layer { type: 'Data' data_param { source: 's' }
                            transform_param { scale: 2 mean_file: 'm' crop_size: 3 mirror: true } }
                    layer { type: 'ImageData' image_data_param { } transform_param { crop_size: 4 } }
                    layer { type: 'WindowData' window_data_param { } transform_param { mirror: false scale: 5 } }
                    layer { type: 'HDF5Data' data_param { scale: 6 } })");
}

/// Rule for most names: "INNER_PRODUCT" -> "InnerProduct".
std::string camel_case(const std::string& enumeration) {
  std::string name;
  bool start = true;
  for (const char c : enumeration) {
    if (c != '_') name += start ? c : static_cast<char>(std::tolower(c));
    start = c == '_';
  }
  return name;
}

/// FCN-8s has pads of 100 and five poolings; the expected offsets are its authors' for Caffe's
/// Crop.
TEST(UpgradeV1, CropsOfFcnFindTheirOffsets) {
  std::string text = "input: 'data' input_dim: [1, 3, 500, 500]\n", last = "data";
  const auto add = [&](const std::string& type, const std::string& name, const std::string& bottoms,
                       const std::string& param = "") {
    text += str("layers { name: '", name, "' type: ", type, " ", bottoms, " top: '", name, "' ",
                param, " }\n");
    last = name;
  };
  const auto one = [](const std::string& bottom) { return "bottom: '" + bottom + "'"; };
  const auto two = [&](const std::string& a, const std::string& b) {
    return one(a) + " " + one(b);
  };
  const auto window = [](const char* kind, int kernel, int stride, int pad) {
    return str(kind, "_param { kernel_size: ", kernel, " stride: ", stride, " pad: ", pad, " }");
  };
  for (int i = 1; i <= 5; ++i) {
    add("CONVOLUTION", str("conv", i), one(last), window("convolution", 3, 1, i == 1 ? 100 : 1));
    add("POOLING", str("pool", i), one(last), window("pooling", 2, 2, 0));
  }
  add("CONVOLUTION", "fc6", one("pool5"), window("convolution", 7, 1, 0));
  add("DECONVOLUTION", "up2", one("fc6"), window("convolution", 4, 2, 0));
  add("CROP", "crop4", two("pool4", "up2"));
  add("ELTWISE", "sum4", two("up2", "crop4"));
  add("DECONVOLUTION", "up4", one("sum4"), window("convolution", 4, 2, 0));
  add("CROP", "crop3", two("pool3", "up4"));
  add("ELTWISE", "sum3", two("up4", "crop3"));
  add("DECONVOLUTION", "up8", one("sum3"), window("convolution", 16, 8, 0));
  add("CROP", "score", two("up8", "data"));
  const NetFile file = parse_net(text, "net");
  std::vector<int> offsets;
  for (const caffe::LayerParameter& layer : file.net.layer())
    if (layer.type() == "Crop")
      for (const uint32_t offset : layer.crop_param().offset()) offsets.push_back(offset);
  EXPECT_EQ(offsets, (std::vector<int>{5, 5, 9, 9, 31, 31}));
}

TEST(UpgradeV1, CropsThatCannotBeAlignedAreLeft) {
  const std::string net =
      "input: 'data' input_dim: [1, 3, 8, 8] layers { name: 'p' type: POOLING bottom: 'data' top: "
      "'p' pooling_param { kernel_size: 2 stride: 2 } }";
  const auto type = [&](const std::string& layer) {
    return parse_net(net + layer, "net").net.layer(2).type();
  };
  EXPECT_EQ(type("layers { type: CROP bottom: 'p' bottom: 'data' }"), "CROP");
  EXPECT_EQ(type("layers { type: CROP bottom: 'p' bottom: 'nowhere' }"), "CROP");
  EXPECT_EQ(type("layers { type: CROP bottom: 'data' bottom: 'data' }"), "Crop");
}

TEST(UpgradeV1, SoManyCropsAreNotAligned) {
  std::string net = "input: 'data' input_dim: [1, 3, 8, 8] ";
  for (int i = 0; i < 101; ++i)
    net += "layers { name: 'c' type: CROP bottom: 'data' bottom: 'data' }";
  EXPECT_EQ(upgrade_error(net),
            "net: layer 'c' (Crop): its offset is not computed, because the net has 101 crops "
            "(limit 100); "
            "give crop_param { axis: 2 offset: ... }");
}

TEST(Upgrade, CropsWithoutOffsetMayBeOfFcn) {
  const auto net = [](const std::string& crop) {
    return "layer { name: 'data' type: 'Input' top: 'data' } layer { name: 'c' type: 'Convolution' "
           "bottom: 'data' top: 'c' convolution_param { kernel_size: 3 pad: 35 } } layer { name: "
           "'up' type: 'Crop' bottom: 'c' bottom: 'data' top: 'up' " +
           crop + " }";
  };
  EXPECT_EQ(upgrade_error(net("")),
            "net: layer 'up' (Crop): has no crop_param: forks of FCN and HED compute the offset, "
            "Caffe starts at 0; add crop_param { axis: 2 offset: 34 offset: 34 } for theirs, or "
            "crop_param { axis: 2 offset: 0 } for Caffe's");
  expect_upgrade(net("crop_param { axis: 2 offset: 0 }"), net("crop_param { axis: 2 offset: 0 }"));
  EXPECT_HAS(
      parse_net(net(""), "net", {.allow_unknown_fields = true}).warnings.at(0),
      "starts at the first pixel, as in Caffe; forks of FCN and HED compute crop_param { axis: "
      "2 offset: 34 offset: 34 }");
}

/// C3D v1.0 (V1 types) and v1.1, and lists of V2.
TEST(Upgrade, VolumesAreConvolutionsAndPoolings) {
  const std::string conv =
      "layer { name: 'c' type: 'Convolution' bottom: 'data' top: 'c' convolution_param { "
      "num_output: 4 kernel_size: [2, 3, 3] stride: [1, 2, 2] pad: [1, 0, 0] } }";
  const std::string pool =
      "layer { name: 'p' type: 'Pooling' bottom: 'c' top: 'p' pooling_param { kernel_size: 2 "
      "stride: 2 kernel_size_nd: [1, 2, 2] stride_nd: [1, 2, 2] } }";
  const std::string c_param =
      "num_output: 4 kernel_size: 3 kernel_depth: 2 stride: 2 temporal_pad: 1 filter_group: 2";
  const std::string p_param = "kernel_size: 2 kernel_depth: 1 stride: 2";
  expect_upgrade(
      "layers { name: 'c' type: CONVOLUTION3D bottom: 'data' top: 'c' "
      "convolution_param { " +
          c_param +
          " } } layers { name: 'p' type: POOLING3D "
          "bottom: 'c' top: 'p' pooling_param { " +
          p_param + " } }",
      conv + pool);
  expect_upgrade(
      "layer { name: 'c' type: 'Convolution3D' bottom: 'data' top: 'c' "
      "convolution3d_param { " +
          c_param +
          " } } layer { name: 'p' type: 'Pooling3D' "
          "bottom: 'c' top: 'p' pooling3d_param { " +
          p_param + " } }",
      conv + pool);
  expect_upgrade(
      "layer { name: 'c' type: 'Pooling3D' bottom: 'data' top: 'c' pooling3d_param { "
      "kernel_size: 2 stride: 2 pad: 0 pad_l: 0 kernel_l: 1 stride_l: 1 } }",
      "layer { name: 'c' type: 'Pooling' bottom: 'data' top: 'c' pooling_param { kernel_size: 2 "
      "stride: 2 pad: 0 kernel_size_nd: [1, 2, 2] stride_nd: [1, 2, 2] } }");
  for (const char* sizes :
       {"kernel_size: 1 kernel_size: 2 kernel_size: 2", "kernel_size: [1, 2, 2]"})
    expect_upgrade(
        std::string("layer { name: 'p' type: 'Pooling' bottom: 'c' top: 'p' pooling_param { ") +
            sizes + " stride: 2 } }",
        "layer { name: 'p' type: 'Pooling' bottom: 'c' top: 'p' pooling_param { "
        "kernel_size: 1 stride: 2 kernel_size_nd: [1, 2, 2] } }");
}

TEST(Upgrade, OfSynopsysFork) {
  expect_upgrade(
      "layer { name: 'r' type: 'ReLU' bottom: 'data' top: 'r' relu_param { relu6: true } }",
      "layer { name: 'r' type: 'ReLU6' bottom: 'data' top: 'r' relu_param { } }");
  struct {
    const char *before, *after;
  } cases[] = {
      {"pad_l: 0 pad_r: 0 pad_t: 0 pad_b: 0", ""},
      {"pad_l: 0 pad_r: 0 pad: 2", "pad: 2"},
      {"pad_l: 2 pad_r: 2 pad_t: 1 pad_b: 1", "pad_h: 1 pad_w: 2"},
      {"pad_r: 1 pad_b: 1", "pad_h: 0 pad_w: 0 pad_b: 1 pad_r: 1"},
      {"pad_l: 1 pad_r: 2 pad_t: 1 pad_b: 1", "pad_h: 1 pad_w: 1 pad_b: 1 pad_r: 2"},
      {"pad_h: 1 pad_w: 1 pad_b: 1 pad_r: 2", "pad_h: 1 pad_w: 1 pad_b: 1 pad_r: 2"},
      {"pad_l: 1 pad: 2", "pad_l: 1 pad: 2"},
  };
  for (const auto& [before, after] : cases)
    for (const std::string param : {"convolution_param", "pooling_param"}) {
      const std::string head =
          "layer { name: 'c' type: 'Pooling' bottom: 'data' top: 'c' " + param + " { ";
      expect_upgrade(head + before + " } }", head + after + " } }");
    }
}

/// Each in the words of the other layer that computes it.
TEST(Upgrade, LayersOfForksThatAnotherLayerComputes) {
  const auto layer = [](const std::string& type, const std::string& param, int bottoms = 1) {
    std::string text = "layer { name: 'l' type: '" + type + "' top: 't' ";
    for (int i = 0; i < bottoms; ++i) text += str("bottom: 'b", i, "' ");
    return text + param + " }";
  };
  // (ln 5 - ln 3) / (5 - 3)
  expect_upgrade(layer("Insanity", "insanity_param { lb: 3 ub: 5 }"),
                 layer("ReLU", "relu_param { negative_slope: 0.25541282 }"));
  expect_upgrade(layer("BReLU", "brelu_param { maxval: 2 }"),
                 layer("Clip", "clip_param { min: 0 max: 2 }"));
  for (const auto& [given, wanted] :
       {std::pair("stride: 3", "stride: 3"), std::pair("stride_h: 2", "stride_h: 2"),
        std::pair("stride: 1 stride: 2", "stride: 1 stride_nd: [1, 2]")}) {
    const std::string size = "{ pool: AVE kernel_size: 2 ";
    expect_upgrade(layer("PoolingND", str("pooling_nd_param ", size, given, " }")),
                   layer("Pooling", str("pooling_param ", size, wanted, " }")));
  }
  expect_upgrade(
      layer("Reshape", "reshape_param { shape { dim: 1 } pixelshuffler: 2 }"),
      layer("DepthToSpace", "depth_to_space_param { block_size: 2 data_format: 'CRD' }"));
  const std::string twice = "scale_height: 2 scale_width: 2 ";
  expect_upgrade(layer("ResizeNearestNeighbor",
                       "resize_nearest_neighbor_param { data_format: 'NCHW' " + twice + "}"),
                 layer("Upsample", "upsample_param { scale: 2 }"));
  const std::string sizes = "kernel_size: 2 stride: 2 unpool_h: 5 unpool_w: 7 }";
  for (const std::string type : {"Unpooling", "UnPooling"})
    expect_upgrade(layer(type, "unpooling_param { " + sizes, 2),
                   layer("Upsample", "upsample_param { upsample_h: 5 upsample_w: 7 }", 2));
  expect_upgrade(
      "layers { name: 'l' type: UNPOOLING bottom: 'b0' bottom: 'b1' top: 't' "
      "unpooling_param { unpool: MAX unpool_size: 4 } }",
      layer("Upsample", "upsample_param { upsample_h: 4 upsample_w: 4 }", 2));
  for (const std::string& same :
       {layer("Unpooling", "unpooling_param { unpool: AVE " + sizes, 2),
        layer("Unpooling", "unpooling_param { " + sizes), layer("Unpooling", "", 2),
        layer("PoolingND", "pooling_nd_param { kernel_size: 2 pad: 1 }"),
        layer("PoolingND", "pooling_nd_param { kernel_size: 2 pad_nd: [0, 1, 0] }"),
        layer("PoolingND", "pooling_nd_param { kernel_size: 2 } pooling_param { stride: 2 }"),
        layer("Insanity", "insanity_param { ub: inf }"),
        layer("Insanity", "insanity_param { lb: -3 }"),
        layer("ResizeNearestNeighbor", "resize_nearest_neighbor_param { " + twice + "}")})
    expect_upgrade(same, same);
}

TEST(UpgradeV1, EveryTypeHasItsName) {
  const std::map<std::string, std::string> irregular = {{"NONE", ""},
                                                        {"ABSVAL", "AbsVal"},
                                                        {"ARGMAX", "ArgMax"},
                                                        {"BNLL", "BNLL"},
                                                        {"LRN", "LRN"},
                                                        {"HDF5_DATA", "HDF5Data"},
                                                        {"HDF5_OUTPUT", "HDF5Output"},
                                                        {"MVN", "MVN"},
                                                        {"RELU", "ReLU"},
                                                        {"TANH", "TanH"},
                                                        {"SOFTMAX_LOSS", "SoftmaxWithLoss"}};
  const auto* types = caffe::V1LayerParameter::LayerType_descriptor();
  EXPECT_EQ(types->value_count(), 40);
  for (int i = 0; i < types->value_count(); ++i) {
    const std::string v1 = types->value(i)->name();
    const auto special = irregular.find(v1);
    const std::string v2 = special != irregular.end() ? special->second : camel_case(v1);
    expect_upgrade("layers { type: " + v1 + " }", "layer { type: '" + v2 + "' }");
  }
}

TEST(UpgradeV1, EveryMessageFieldHasATwinInV2) {
  const auto* v1 = caffe::V1LayerParameter::descriptor();
  for (int i = 0; i < v1->field_count(); ++i) {
    const FieldDescriptor* field = v1->field(i);
    if (!field->message_type() || field->name() == "layer") continue;
    const FieldDescriptor* twin =
        caffe::LayerParameter::descriptor()->FindFieldByName(field->name());
    ASSERT_TRUE(twin) << field->name();
    EXPECT_EQ(twin->message_type(), field->message_type()) << field->name();
    EXPECT_EQ(twin->is_repeated(), field->is_repeated()) << field->name();
  }
}

TEST(UpgradeV0, NetworkLayers) {
  expect_upgrade(R"(
    layers { layer { name: 'c' type: 'conv' num_output: 8 biasterm: false kernelsize: 5 group: 2 stride: 3 pad: 1
                     weight_filler { type: 'w' } bias_filler { type: 'b' } blobs { num: 1 }
                     blobs_lr: 1 blobs_lr: 2 weight_decay: 3 } top: 'c' }
    layers { layer { name: 'p' type: 'pool' pool: AVE kernelsize: 3 stride: 2 pad: 1 } bottom: 'c' top: 'p' }
    layers { layer { name: 'n' type: 'lrn' local_size: 3 alpha: 2 beta: 0.5 k: 7 } bottom: 'p' top: 'n' }
    layers { layer { name: 'f' type: 'innerproduct' num_output: 9 biasterm: true weight_filler { value: 1 }
                     bias_filler { value: 2 } } bottom: 'n' top: 'f' }
    layers { layer { name: 'd' type: 'dropout' dropout_ratio: 0.25 } bottom: 'f' top: 'f' }
    layers { layer { name: 'k' type: 'concat' concat_dim: 0 } bottom: 'f' bottom: 'n' top: 'k' })",
                 R"(
    layer { name: 'c' type: 'Convolution' top: 'c' blobs { num: 1 }
            param { lr_mult: 1 decay_mult: 3 } param { lr_mult: 2 }
            convolution_param { num_output: 8 bias_term: false kernel_size: 5 group: 2 stride: 3 pad: 1
                                weight_filler { type: 'w' } bias_filler { type: 'b' } } }
    layer { name: 'p' type: 'Pooling' bottom: 'c' top: 'p'
            pooling_param { pool: AVE kernel_size: 3 stride: 2 pad: 1 } }
    layer { name: 'n' type: 'LRN' bottom: 'p' top: 'n' lrn_param { local_size: 3 alpha: 2 beta: 0.5 k: 7 } }
    layer { name: 'f' type: 'InnerProduct' bottom: 'n' top: 'f'
            inner_product_param { num_output: 9 bias_term: true weight_filler { value: 1 }
                                  bias_filler { value: 2 } } }
    layer { name: 'd' type: 'Dropout' bottom: 'f' top: 'f' dropout_param { dropout_ratio: 0.25 } }
    layer { name: 'k' type: 'Concat' bottom: 'f' bottom: 'n' top: 'k' concat_param { concat_dim: 0 } })");
}

TEST(UpgradeV0, DataAndLossLayers) {
  expect_upgrade(R"(
    layers { layer { type: 'data' source: 's' batchsize: 2 rand_skip: 3 scale: 4 meanfile: 'm' cropsize: 5 mirror: true } }
    layers { layer { type: 'images' source: 's' batchsize: 2 rand_skip: 3 shuffle_images: true new_height: 4 new_width: 5 } }
    layers { layer { type: 'hdf5_data' source: 's' batchsize: 2 } }
    layers { layer { type: 'window_data' source: 's' batchsize: 2 det_fg_threshold: 0.1 det_bg_threshold: 0.2
                     det_fg_fraction: 0.3 det_context_pad: 4 det_crop_mode: 'c' } }
    layers { layer { type: 'infogain_loss' source: 's' } }
    layers { layer { type: 'hdf5_output' hdf5_output_param { file_name: 'f' } } })",
                 R"(
    layer { type: 'Data' data_param { source: 's' batch_size: 2 rand_skip: 3 }
            transform_param { scale: 4 mean_file: 'm' crop_size: 5 mirror: true } }
    layer { type: 'ImageData'
            image_data_param { source: 's' batch_size: 2 rand_skip: 3 shuffle: true new_height: 4 new_width: 5 } }
    layer { type: 'HDF5Data' hdf5_data_param { source: 's' batch_size: 2 } }
    layer { type: 'WindowData'
            window_data_param { source: 's' batch_size: 2 fg_threshold: 0.1 bg_threshold: 0.2 fg_fraction: 0.3
                                context_pad: 4 crop_mode: 'c' } }
    layer { type: 'InfogainLoss' infogain_loss_param { source: 's' } }
    layer { type: 'HDF5Output' hdf5_output_param { file_name: 'f' } })");
}

TEST(UpgradeV0, EveryTypeHasItsName) {
  const std::map<std::string, std::string> types = {
      {"accuracy", "Accuracy"},
      {"bnll", "BNLL"},
      {"euclidean_loss", "EuclideanLoss"},
      {"flatten", "Flatten"},
      {"im2col", "Im2col"},
      {"multinomial_logistic_loss", "MultinomialLogisticLoss"},
      {"relu", "ReLU"},
      {"sigmoid", "Sigmoid"},
      {"softmax", "Softmax"},
      {"softmax_loss", "SoftmaxWithLoss"},
      {"split", "Split"},
      {"tanh", "TanH"}};
  for (const auto& [v0, v2] : types) {
    expect_upgrade("layers { layer { type: '" + v0 + "' } }", "layer { type: '" + v2 + "' }");
  }
  EXPECT_EQ(upgrade_error("layers { layer { type: 'relu' } }\n layers { layer { type: 'covn' } }"),
            "net:2:2: unknown V0 layer type 'covn' (did you mean 'conv'?)");
}

TEST(UpgradeV0, PaddingFoldsIntoEveryFollower) {
  expect_upgrade(R"(input: 'x' input_shape { dim: 1 }
    layers { layer { name: 'q' type: 'padding' pad: 2 } bottom: 'x' top: 'q' }
    layers { layer { name: 'c' type: 'conv' } bottom: 'q' top: 'c' }
    layers { layer { name: 'p' type: 'pool' } bottom: 'q' top: 'p' }
    layers { layer { name: 'r' type: 'relu' } bottom: 'p' top: 'p' })",
                 R"(
    layer { name: 'input' type: 'Input' top: 'x' input_param { shape { dim: 1 } } }
    layer { name: 'c' type: 'Convolution' bottom: 'x' top: 'c' convolution_param { pad: 2 } }
    layer { name: 'p' type: 'Pooling' bottom: 'x' top: 'p' pooling_param { pad: 2 } }
    layer { name: 'r' type: 'ReLU' bottom: 'p' top: 'p' })");
}

TEST(UpgradeV0, PaddingInPlaceOfItsInput) {
  expect_upgrade(R"(input: 'x' input_shape { }
    layers { layer { name: 'q' type: 'padding' pad: 1 } bottom: 'x' top: 'x' }
    layers { layer { name: 'c' type: 'conv' } bottom: 'x' top: 'x' }
    layers { layer { name: 'd' type: 'conv' } bottom: 'x' top: 'd' })",
                 R"(
    layer { name: 'input' type: 'Input' top: 'x' input_param { shape { } } }
    layer { name: 'c' type: 'Convolution' bottom: 'x' top: 'x' convolution_param { pad: 1 } }
    layer { name: 'd' type: 'Convolution' bottom: 'x' top: 'd' })");
}

TEST(UpgradeV0, PaddingThatCannotBeFolded) {
  const std::string start =
      "input: 'x' input: 'z'\nlayers { layer { name: 'q' type: 'padding' } bottom: 'x' top: 'q' "
      "}\n";
  EXPECT_EQ(
      upgrade_error(start + "layers { layer { name: 'r' type: 'relu' } bottom: 'q' top: 'r' }"),
      "net:3:1: layer 'r' (ReLU): after padding layer 'q': only conv and pool can follow a padding "
      "layer");
  EXPECT_EQ(
      upgrade_error(start +
                    "layers { layer { name: 'c' type: 'conv' } bottom: 'q' bottom: 'z' top: 'c' }"),
      "net:3:1: layer 'c' (Convolution): after padding layer 'q': expected one bottom");
  EXPECT_EQ(
      upgrade_error("input: 'x'\nlayers { layer { name: 'q' type: 'padding' pads: 2 } bottom: 'x' "
                    "top: 'q' } layers { layer { name: 'c' type: 'conv' } bottom: 'q' top: 'c' }"),
      "net:2:44: layer 'c' (Convolution): unknown field 'pads' in V0LayerParameter (did you mean "
      "'pad'?)")
      << "what the padding lacks is its follower's";
}

TEST(UpgradeV0, ReportsFieldsItCannotCarryOver) {
  const NetFile file =
      expect_upgrade("layers { name: 'z' layer { name: 'r' type: 'relu' num_output: 3 } }",
                     "layer { name: 'r' type: 'ReLU' }");
  EXPECT_EQ(file.warnings,
            (std::vector<std::string>{
                "net: layer 'r': num_output has no meaning for V0 type 'relu' and is ignored",
                "net: layer 'r': V1 field name next to a V0 layer is ignored, as in Caffe"}));
  EXPECT_EQ(upgrade_error("layers { layer { type: 'relu' } } layers { type: RELU }"),
            "net:1:35: V1 layer in a net with V0 layers (`layers { layer {`)");
}

void expect_same_net(const std::filesystem::path& a, const std::filesystem::path& b) {
  SCOPED_TRACE(a.string());
  MessageDifferencer differencer;
  std::string difference;
  differencer.ReportDifferencesToString(&difference);
  EXPECT_TRUE(differencer.Compare(read_net(a).net, read_net(b).net)) << difference;
}

TEST(UpgradeGolden, SameAsCaffesUpgradeTools) {
  const std::filesystem::path folder = test::golden("formats");
  expect_same_net(folder / "mini_v0.prototxt", folder / "mini_v0_upgraded_by_caffe.prototxt");
  expect_same_net(folder / "mini_v1.prototxt", folder / "mini_v1_upgraded_by_caffe.prototxt");
  expect_same_net(folder / "mini_v2_input_dim.prototxt", folder / "mini_v2_input_shape.prototxt");
}

TEST(UpgradeGolden, V1TwinsOfWholeNets) {
  REVISIT_NEED_SHARED(folder, "golden/nets/vgg_cnn_s");
  for (const std::string variant : {"pool5", "conv3+pool5", "conv4+pool5"}) {
    expect_same_net(folder / (variant + "_v1.prototxt"), folder / (variant + ".prototxt"));
  }
}

}  // namespace
}  // namespace revisit::proto
