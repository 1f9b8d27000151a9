#include "revisit/engine/net.h"
#include "testing.h"

namespace revisit::engine {
namespace {

/// A net with inputs `data` and `other` (1 x 4 x 8 x 9 each) and `layers`.
Net net_of(const std::string& layers) {
  const TempDir dir;
  write_file(dir / "net.prototxt",
             "layer { name: 'data' type: 'Input' top: 'data' top: 'other' "
             "input_param { shape { dim: 1 dim: 4 dim: 8 dim: 9 } } } " +
                 layers);
  return Net::load_without_weights(dir / "net.prototxt");
}

Net in_place(const std::string& type, const std::string& param = "") {
  return net_of("layer { name: 'l' type: '" + type + "' bottom: 'data' top: 'data' " + param + "}");
}

TEST(InPlace, IsForLayersThatReadEachValueBeforeTheyWriteIt) {
  for (const std::string type :
       {"BN",        "BNLL",  "BatchNorm", "Bias",    "Clip",      "Dropout", "ELU",      "Exp",
        "HardSwish", "Log",   "Mish",      "MVN",     "Normalize", "Power",   "PReLU",    "ReLU",
        "ReLU6",     "Scale", "Sigmoid",   "Softmax", "Swish",     "TanH",    "Threshold"})
    EXPECT_EQ(in_place(type).outputs().size(), 2U) << type;
}

TEST(InPlace, IsRefusedWhereItIsUndefined) {
  const std::string kernel = "{ kernel_size: 1 num_output: 4 }";
  const auto refused = [](const std::string& type, const std::string& param = "") {
    expect_error<InputError>([&] { in_place(type, param); },
                             {"net.prototxt: layer 'l' (" + type + ")", "in place"});
  };
  refused("AbsVal");
  refused("ArgMax");
  refused("CropCenter",
          "crop_center_param { crop_size: 0 crop_size: 0 crop_size: 0 crop_size: 0 }");
  refused("Convolution", "convolution_param " + kernel);
  refused("Flatten");
  refused("Flip");
  refused("InnerProduct", "inner_product_param { num_output: 4 }");
  refused("LRN");
  refused("Permute");
  refused("Pooling", "pooling_param { kernel_size: 1 }");
  refused("Reduction");
  refused("Reorg");
  refused("Reshape", "reshape_param { shape { dim: 0 dim: 0 dim: 0 dim: 0 } }");
  refused("Reverse");
  refused("ShuffleChannel");
  refused("Slice");
  refused("Split");
  refused("Tile", "tile_param { tiles: 1 }");
  refused("Transpose", "transpose_param { dim: 0 dim: 1 dim: 2 dim: 3 }");
}

TEST(InPlace, OfEltwiseDependsOnTheOperation) {
  const auto eltwise = [](const std::string& operation) {
    net_of(
        "layer { name: 'e' type: 'Eltwise' bottom: 'data' bottom: 'other' top: 'data' "
        "eltwise_param { operation: " +
        operation + " } }");
  };
  eltwise("PROD");
  for (const std::string operation : {"SUM", "MAX"})
    expect_error<InputError>([&] { eltwise(operation); }, {"'e' (Eltwise)", "in place"});
}

TEST(InPlace, CountsForEveryOutput) {
  expect_error<InputError>(
      [] {
        net_of(
            "layer { name: 'c' type: 'Convolution' bottom: 'data' bottom: 'other' top: 'new' "
            "top: 'other' convolution_param { num_output: 4 kernel_size: 1 } }");
      },
      {"'c' (Convolution)", "in place"});
}

TEST(Phase, OfADropoutMustNotBeTrain) {
  net_of("layer { name: 'd' type: 'Dropout' bottom: 'data' top: 'd' phase: TEST }");
  expect_error<UnsupportedError>(
      [] { net_of("layer { name: 'd' type: 'Dropout' bottom: 'data' top: 'd' phase: TRAIN }"); },
      {"'d' (Dropout)", "phase: TRAIN"});
}

TEST(Inputs, HaveNoBottom) {
  expect_error<InputError>(
      [] {
        net_of(
            "layer { name: 'b' type: 'Input' bottom: 'data' top: 'b' "
            "input_param { shape { dim: 1 } } }");
      },
      {"'b' (Input)", "expected 0 bottoms, found 1"});
}

TEST(ParamSpecs, AreAtMostOneForEachWeightBlob) {
  const auto params = [](const std::string& type, int n) {
    std::string text = "layer { name: 'l' type: '" + type + "' bottom: 'data' top: 'l' ";
    for (int i = 0; i < n; ++i) text += "param { lr_mult: 0 } ";
    net_of(text + "}");
  };
  params("Scale", 1);
  params("BatchNorm", 3);
  expect_error<InputError>([&] { params("Scale", 2); }, {"'l' (Scale)", "1 weight", "found 2"});
  expect_error<InputError>([&] { params("BatchNorm", 4); }, {"3 weight", "found 4"});
  expect_error<InputError>([&] { params("ReLU", 1); }, {"0 weight", "found 1"});
}

TEST(Silence, KeepsItsInputsAsInputsOfTheNet) {
  const std::string layers =
      "layer { name: 't' type: 'TanH' bottom: 'data' top: 't' } "
      "layer { name: 's' type: 'Silence' bottom: 'extra' }";
  const std::string extra =
      "layer { name: 'extra' type: 'Input' top: 'extra' input_param { shape { dim: 3 } } } ";
  const Net net = net_of(extra + layers);
  EXPECT_EQ(net.outputs(), (std::vector<std::string>{"other", "t"}));
  EXPECT_EQ(net.inputs().size(), 3U);
  engine::Run run(net.plan());
  run.input("extra").data[0] = 1;
  run.forward();
}

TEST(Buffers, OfReusedInputsStayWhileTheyAreRead) {
  // tanh's output is read three times after a layer that could overwrite it.
  const Net net = net_of(
      "layer { name: 'p' type: 'Power' bottom: 'data' top: 'p' power_param { shift: 1 } } "
      "layer { name: 'q' type: 'Power' bottom: 'p' top: 'q' power_param { scale: 10 } } "
      "layer { name: 'm' type: 'Eltwise' bottom: 'p' bottom: 'q' bottom: 'p' top: 'm' "
      "eltwise_param { operation: PROD } } "
      "layer { name: 's' type: 'Scale' bottom: 'm' bottom: 'm' top: 's' "
      "scale_param { axis: 0 } }");
  engine::Run run(net.plan());
  std::fill_n(run.input("data").data, 288, 1.0F);
  run.forward();
  for (const float value : run.output("s").values()) EXPECT_EQ(value, 6400);  // (2 * 20 * 2)^2
}

TEST(GoldenParse, LayersRejectTheTextsThatCaffeRejects) {
  const std::filesystem::path folder = test::golden("parse");
  for (const std::string name :
       {"bn_four_params", "concat_mismatch", "eltwise_coeff_count", "eltwise_prod_coeff",
        "eltwise_shape_mismatch", "exp_base_neg2", "lrn_2axis", "lrn_even_size", "net_inplace_conv",
        "net_inplace_lrn", "net_inplace_pool", "net_two_bottoms_relu", "reshape_bad_count",
        "reshape_two_m1", "slice_uneven"}) {
    SCOPED_TRACE(name);
    expect_error<InputError>([&] { Net::load_without_weights(folder / (name + ".prototxt")); },
                             {name + ".prototxt: layer '"});
  }
}

}  // namespace
}  // namespace revisit::engine
