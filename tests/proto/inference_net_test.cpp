#include <google/protobuf/text_format.h>
#include <google/protobuf/util/message_differencer.h>

#include "revisit/proto/net_file.h"
#include "testing.h"

namespace revisit::proto {
namespace {

/// Returns warnings.
std::vector<std::string> expect_net(const std::string& text, const std::string& wanted) {
  caffe::NetParameter expected;
  EXPECT_TRUE(google::protobuf::TextFormat::ParseFromString(wanted, &expected));
  const NetFile file = parse_net(text, "net", {.types_with_weights = {"Embed", "InnerProduct"}});
  google::protobuf::util::MessageDifferencer differencer;
  std::string difference;
  differencer.ReportDifferencesToString(&difference);
  EXPECT_TRUE(differencer.Compare(expected, file.net)) << difference << file.net.DebugString();
  return file.warnings;
}

const std::string kData =
    "layer { name: 'd' type: 'Data' top: 'data' top: 'label' data_param { batch_size: 5 }"
    "        transform_param { crop_size: 8 } }";
const std::string kInput =
    "layer { name: 'd' type: 'Input' top: 'data' input_param { shape { dim: [5, 3, 8, 8] } } }";
const std::string kFc = "layer { name: 'fc' type: 'InnerProduct' bottom: 'data' top: 'fc' }";

TEST(InferenceNet, RulesOfThePhaseDecide) {
  expect_net(R"(
    layer { name: 'train' type: 'Input' top: 'x' include { phase: TRAIN } }
    layer { name: 'test' type: 'Input' top: 'x' include { phase: TEST } }
    layer { name: 'not_test' type: 'ReLU' bottom: 'x' top: 'y' exclude { phase: TEST } }
    layer { name: 'stage' type: 'ReLU' bottom: 'x' top: 'z' include { stage: 'deploy' } })",
             "layer { name: 'test' type: 'Input' top: 'x' include { phase: TEST } }");
  expect_net(
      "state { phase: TRAIN level: 2 stage: 'deploy' }"
      "layer { name: 'a' include { stage: 'deploy' min_level: 0 } }"
      "layer { name: 'b' include { not_stage: 'deploy' } }"
      "layer { name: 'c' include { max_level: -1 } include { phase: TEST } }"
      "layer { name: 'd' exclude { min_level: 3 } exclude { phase: TEST } }"
      "layer { name: 'e' include { min_level: 1 } }",
      "state { phase: TRAIN level: 2 stage: 'deploy' }"  // `caffe test` sets the level to 0
      "layer { name: 'a' include { stage: 'deploy' min_level: 0 } }"
      "layer { name: 'c' include { max_level: -1 } include { phase: TEST } }");
  const NetFile given = parse_net(
      "state { stage: 'file' }"
      "layer { name: 'a' include { phase: TRAIN min_level: 2 stage: ['file', 'given'] } }"
      "layer { name: 'b' exclude { stage: 'given' } }",
      "net", {.train = true, .level = 2, .stages = {"given"}});
  ASSERT_EQ(given.net.layer_size(), 1);
  EXPECT_EQ(given.net.layer(0).name(), "a");
  expect_error<InputError>(
      [] { parse_net("layer { name: 'both' include { } exclude { } }", "net"); },
      {"net: layer 'both'", "not both"});
  expect_error<InputError>([] { parse_net("layer { name: 'a' exclude { } }", "net"); },
                           {"net: has no layers for inference"});
}

TEST(InferenceNet, NetsWithoutDataLayersKeepTheirLossesAndLabels) {
  const std::string net =
      "layer { name: 'in' type: 'Input' top: 'x' top: 'label' }"
      "layer { name: 'dummy' type: 'DummyData' top: 'h' }"
      "layer { name: 'loss' type: 'SoftmaxWithLoss' bottom: 'x' bottom: 'label' top: 'loss' }"
      "layer { name: 'acc' type: 'Accuracy' bottom: 'x' bottom: 'label' top: 'acc' }";
  EXPECT_TRUE(expect_net(net, net).empty());
}

TEST(InferenceNet, OfAClassifier) {
  const auto warnings = expect_net(
      kData + kFc +
          "layer { name: 'accuracy' type: 'Accuracy' bottom: 'fc' bottom: 'label' top: 'acc' }"
          "layer { name: 'loss' type: 'SoftmaxWithLoss' bottom: 'fc' bottom: 'label' top: 'loss'"
          "        softmax_param { axis: 2 } }",
      kInput + kFc +
          "layer { name: 'prob' type: 'Softmax' bottom: 'fc' top: 'prob' softmax_param { axis: 2 } "
          "}");
  EXPECT_EQ(warnings,
            (std::vector<std::string>{
                "net: layer 'd' (Data) is now the input 'data', 5x3x8x8 (its batch_size and "
                "crop_size, 3 channels assumed)",
                "net: layer 'loss' (SoftmaxWithLoss) is now 'prob' (Softmax) of 'fc'",
                "net: skipped, for training only: 'accuracy' (Accuracy)"}));
}

TEST(InferenceNet, PreprocessingThatIsLostIsSaid) {
  const auto warnings = expect_net(
      "layers { name: 'd' type: IMAGE_DATA top: 'data' top: 'label'"
      " image_data_param { batch_size: 2 new_height: 6 new_width: 7 scale: 0.5 mean_file: 'm' } }"
      "layers { name: 'r' type: RELU bottom: 'data' top: 'r' }",
      "layer { name: 'd' type: 'Input' top: 'data' input_param { shape { dim: [2, 3, 6, 7] } } }"
      "layer { name: 'r' type: 'ReLU' bottom: 'data' top: 'r' }");
  EXPECT_EQ(warnings[0],
            "net: layer 'd' (ImageData) is now the input 'data', 2x3x6x7 (its batch_size, "
            "new_height and new_width); the caller must apply its preprocessing: mean_file 'm', "
            "scale 0.5");
}

TEST(InferenceNet, ShapesThatTheFileSaysAndDoesNot) {
  const auto input = [](const std::string& layer) {
    const NetFile file = parse_net("layer { name: 'd' top: 'x' " + layer + " }" +
                                       "layer { name: 'r' type: 'ReLU' bottom: 'x' top: 'r' }",
                                   "net");
    EXPECT_EQ(file.net.layer(0).type(), "Input");
    const auto& shapes = file.net.layer(0).input_param().shape();
    return shapes.empty() ? std::vector<int64_t>{}
                          : std::vector<int64_t>(shapes[0].dim().begin(), shapes[0].dim().end());
  };
  using Shape = std::vector<int64_t>;
  EXPECT_EQ(input("type: 'MemoryData' memory_data_param { batch_size: 2 channels: 3 height: 4 "
                  "width: 5 } transform_param { crop_size: 2 }"),
            (Shape{2, 3, 4, 5}));
  EXPECT_EQ(input("type: 'WindowData' window_data_param { batch_size: 2 } transform_param { "
                  "crop_size: 6 }"),
            (Shape{2, 3, 6, 6}));
  EXPECT_EQ(
      input("type: 'ImageData' image_data_param { is_color: false new_height: 9 new_width: 9 } "
            "transform_param { crop_size: 6 }"),
      (Shape{1, 1, 6, 6}));
  EXPECT_EQ(input("type: 'Data' data_param { batch_size: 4 } transform_param { crop_size: 6 "
                  "force_gray: true }"),
            (Shape{4, 1, 6, 6}));
  EXPECT_EQ(input("type: 'Data' data_param { batch_size: 4 }"), Shape{});
  EXPECT_EQ(input("type: 'Data' transform_param { crop_size: 6 }"), Shape{});
  EXPECT_EQ(input("type: 'HDF5Data' hdf5_data_param { batch_size: 4 }"), Shape{});
}

TEST(InferenceNet, OfADetectorOfSsd) {
  const auto warnings = expect_net(R"(
    layer { name: 'd' type: 'AnnotatedData' top: 'data' top: 'label' data_param { batch_size: 2 }
            transform_param { resize_param { prob: 1 height: 7 width: 9 } emit_constraint { } }
            annotated_data_param { batch_sampler { max_sample: 1 } } }
    layer { name: 'fc' type: 'InnerProduct' bottom: 'data' top: 'fc' }
    layer { name: 'p' type: 'PriorBox' bottom: 'fc' bottom: 'data' top: 'p' }
    layer { name: 'out' type: 'DetectionOutput' bottom: 'fc' bottom: 'fc' bottom: 'p' top: 'out' }
    layer { name: 'loss' type: 'MultiBoxLoss' bottom: 'fc' bottom: 'fc' bottom: 'p' bottom: 'label'
            top: 'loss' multibox_loss_param { num_classes: 2 } }
    layer { name: 'e' type: 'DetectionEvaluate' bottom: 'out' bottom: 'label' top: 'e'
            detection_evaluate_param { } })",
                                   R"(
    layer { name: 'd' type: 'Input' top: 'data' input_param { shape { dim: [2, 3, 7, 9] } } }
    layer { name: 'fc' type: 'InnerProduct' bottom: 'data' top: 'fc' }
    layer { name: 'p' type: 'PriorBox' bottom: 'fc' bottom: 'data' top: 'p' }
    layer { name: 'out' type: 'DetectionOutput' bottom: 'fc' bottom: 'fc' bottom: 'p' top: 'out' })");
  EXPECT_EQ(warnings.size(), 2U);
}

TEST(InferenceNet, LabelsGoWithAllThatServesThem) {
  expect_net(kData +
                 "layer { name: 'split' type: 'Slice' bottom: 'label' top: 'l1' top: 'l2' }"
                 "layer { name: 'half' type: 'Power' bottom: 'l1' top: 'l1' }"
                 "layer { name: 'dummy' type: 'DummyData' top: 'weights' }" +
                 kFc +
                 "layer { name: 'e' type: 'EuclideanLoss' bottom: 'l1' bottom: 'fc' }"
                 "layer { name: 'i' type: 'InfogainLoss' bottom: 'fc' bottom: 'l2' bottom: "
                 "'weights' top: 'i' }"
                 "layer { name: 'w' type: 'Power' bottom: 'i' top: 'w' }"
                 "layer { name: 's' type: 'Silence' bottom: 'l2' }",
             kInput + kFc);
}

TEST(InferenceNet, KeepsInferenceLayers) {
  // An autoencoder: its target is its input.
  expect_net(kData +
                 "layer { name: 'flat' type: 'Flatten' bottom: 'data' top: 'flat' }"
                 "layer { name: 'code' type: 'InnerProduct' bottom: 'flat' top: 'code' }"
                 "layer { name: 'loss' type: 'EuclideanLoss' bottom: 'flat' bottom: 'code' }",
             kInput +
                 "layer { name: 'flat' type: 'Flatten' bottom: 'data' top: 'flat' }"
                 "layer { name: 'code' type: 'InnerProduct' bottom: 'flat' top: 'code' }");
  // A layer processes the label.
  expect_net(kData + kFc + "layer { name: 'em' type: 'Embed' bottom: 'label' top: 'em' }",
             "layer { name: 'data' type: 'Input' top: 'data'"
             "        input_param { shape { dim: [5, 3, 8, 8] } } }"
             "layer { name: 'label' type: 'Input' top: 'label' input_param { shape { dim: 5 } } }" +
                 kFc + "layer { name: 'em' type: 'Embed' bottom: 'label' top: 'em' }");
  // Silence of outputs other than labels stays.
  expect_net(kData + kFc + "layer { name: 's' type: 'Silence' bottom: 'label' bottom: 'fc' }",
             kInput + kFc + "layer { name: 's' type: 'Silence' bottom: 'fc' }");
  // The input of a loss has no trained layer.
  expect_net(kData +
                 "layer { name: 'r' type: 'ReLU' bottom: 'data' top: 'r' }"
                 "layer { name: 'h' type: 'HingeLoss' bottom: 'r' bottom: 'label' top: 'h' }",
             kInput + "layer { name: 'r' type: 'ReLU' bottom: 'data' top: 'r' }");
}

TEST(InferenceNet, SiameseBranches) {
  const std::string branches =
      "layer { name: 'cut' type: 'Slice' bottom: 'pair' top: 'a' top: 'b' }"
      "layer { name: 'fa' type: 'InnerProduct' bottom: 'a' top: 'fa' param { name: 'w' } }"
      "layer { name: 'fb' type: 'InnerProduct' bottom: 'b' top: 'fb' param { name: 'w' } }";
  expect_net(
      "layer { name: 'd' type: 'Data' top: 'pair' top: 'same' }" + branches +
          "layer { name: 'l' type: 'ContrastiveLoss' bottom: 'fa' bottom: 'fb' bottom: 'same' }",
      "layer { name: 'd' type: 'Input' top: 'pair' }" + branches);
}

TEST(InferenceNet, SoftmaxOnlyWhereItIsClear) {
  const auto loss = [](const std::string& name, const std::string& bottom, const std::string& top) {
    return "layer { name: '" + name + "' type: 'SoftmaxWithLoss' bottom: '" + bottom +
           "' bottom: 'label' top: '" + name + "' " + top + " }";
  };
  const std::string fc2 = "layer { name: 'fc2' type: 'InnerProduct' bottom: 'fc' top: 'fc2' }";
  // With two heads the prediction is ambiguous.
  expect_net(kData + kFc + fc2 + loss("l1", "fc", "") + loss("l2", "fc2", ""), kInput + kFc + fc2);
  // The net has a Softmax already.
  const std::string softmax = "layer { name: 'p' type: 'Softmax' bottom: 'fc' top: 'p' }";
  expect_net(kData + kFc + softmax + loss("l", "fc", ""), kInput + kFc + softmax);
  // Another layer uses the probabilities of the loss.
  const std::string argmax = "layer { name: 'best' type: 'ArgMax' bottom: 'q' top: 'best' }";
  expect_net(
      kData + kFc + loss("l", "fc", "top: 'q'") + argmax,
      kInput + kFc + "layer { name: 'prob' type: 'Softmax' bottom: 'fc' top: 'q' }" + argmax);
  // Another layer has the name 'prob'.
  const std::string prob = "layer { name: 'prob' type: 'InnerProduct' bottom: 'data' top: 'x' }";
  expect_net(kData + prob + loss("l", "x", ""),
             kInput + prob + "layer { name: 'l' type: 'Softmax' bottom: 'x' top: 'l' }");
}

TEST(InferenceNet, OddNetsAreNetsOrErrors) {
  expect_error<InputError>([] { parse_net(kData, "net"); }, {"no layers for inference"});
  parse_net(kData + "layer { name: 'l' type: 'SoftmaxWithLoss' }", "net", {.keep_training = true});
  expect_error<InputError>(
      [] { parse_net(kData + "layer { name: 'l' type: 'SoftmaxWithLoss' }", "net"); },
      {"no layers for inference"});
  EXPECT_EQ(parse_net(kData + "layer { name: 'l' type: 'SoftmaxWithLoss' bottom: 'no' } "
                              "layer { name: 'r' type: 'ReLU' bottom: 'data' top: 'data' }",
                      "net")
                .net.layer_size(),
            3);
}

/// Faster R-CNN's layer in Python, with its param_str.
std::string python_proposal(const std::string& param_str, const std::string& more = "",
                            const std::string& module = "rpn.proposal_layer") {
  return "layer { name: 'p' type: 'Python' bottom: 's' bottom: 'o' bottom: 'i' top: 'r' " + more +
         " python_param { module: '" + module + "' layer: 'ProposalLayer' param_str: \"" +
         param_str + "\" } }";
}

TEST(InferenceNet, ProposalsInPythonBecomeProposals) {
  const auto expect_proposal = [](const std::string& param_str, const std::string& anchors) {
    std::string wanted =
        python_proposal(param_str,
                        "proposal_param { base_size: 16 min_size: 16 pre_nms_topn: 6000 "
                        "post_nms_topn: 300 nms_thresh: 0.7 " +
                            anchors + " }");
    return expect_net(python_proposal(param_str),
                      wanted.replace(wanted.find("Python"), 6, "Proposal"));
  };
  const auto warnings =
      expect_proposal("'feat_stride': 16", "feat_stride: 16 ratio: [0.5, 1, 2] scale: [8, 16, 32]");
  ASSERT_EQ(warnings.size(), 1U);
  for (const char* part :
       {"layer 'p' (Python: ProposalLayer)", "post_nms_topn 300", "min_size 16", "nms_thresh 0.7",
        "ratio 0.5 1 2 and scale 8 16 32", "config.py", "proposal_param"})
    EXPECT_HAS(warnings[0], part);
  // Forms in public nets: a list in braces, a tuple on its own line, ratios of PVANET.
  expect_proposal("{'feat_stride': 8, 'scales': [2, 4.5,]}",
                  "feat_stride: 8 ratio: [0.5, 1, 2] scale: [2, 4.5]");
  expect_proposal("'feat_stride': 16 \\n'scales': !!python/tuple [4, 8]\\n",
                  "feat_stride: 16 ratio: [0.5, 1, 2] scale: [4, 8]");
  expect_proposal("{'feat_stride': 16, 'ratios': [0.333, 2], 'scales': [3]}",
                  "feat_stride: 16 ratio: [0.333, 2] scale: 3");
  expect_proposal("  { \\\"feat_stride\\\" : !!python/tuple [ 16 , ] } \\n ",
                  "feat_stride: 16 ratio: [0.5, 1, 2] scale: [8, 16, 32]");
  const std::string most = "'feat_stride': 16" + std::string(984, ' ');  // of 1001 characters
  for (const std::string& other : std::vector<std::string>{
           "", "feat_stride: 16", "'feat_stride' 16", "{'feat_stride': 16", "'feat_stride': 16}",
           "{'feat_stride': 16,}", "'feat_stride': 16, 'scales': [8]",
           "'feat_stride': 16\\n\\n'scales': [8]", "'feat_stride': 16x",
           "'feat_stride': 16\\n'feat_stride': 16", "'feat_stride': []", "'feat_stride': [16, 8]",
           "'feat_stride': [16", "'feat_stride': [16,,]", "'feat_stride': 1e99",
           "'feat_stride': 16\\n'other': 1", most + "\\n'scales': [8]"})
    EXPECT_TRUE(expect_net(python_proposal(other), python_proposal(other)).empty()) << other;
}

TEST(InferenceNet, LayersInPythonOfPublicForks) {
  const auto python = [](const std::string& from, const std::string& param_str = "",
                         const std::string& bottoms = "bottom: 'b'") {
    const size_t dot = from.rfind('.');
    return "layer { name: 'l' type: 'Python' " + bottoms + " top: 't' python_param { module: '" +
           from.substr(0, dot) + "' layer: '" + from.substr(dot + 1) + "' param_str: \"" +
           param_str + "\" } }";
  };
  const auto becomes = [&](const std::string& before, const std::string& type,
                           const std::string& param) {
    const auto warnings = expect_net(
        before, "layer { name: 'l' type: '" + type + "' bottom: 'b' top: 't' " + param + " }");
    ASSERT_EQ(warnings.size(), 1U);
    EXPECT_HAS(warnings[0], ") is now a " + type);
  };
  becomes(python("yolov2.darknet_reorg"), "Reorg", "reorg_param { stride: 2 }");
  becomes(python("interp.UpsamplingBilinear2d", "{'zoom_factor':2}"), "Upsample",
          "upsample_param { scale: 2 }");
  becomes(python("interp.UpsamplingBilinear2d", "{'old_zoom_factor': 3, 'zoom_factor': '2'}"),
          "Upsample", "upsample_param { scale: 2 }");
  becomes(python("spatial_dropout.SpatialDropoutLayer", "{'drop': 0.5, 'p': 0.2}"), "Power",
          "power_param { scale: 1.25 }");
  becomes(python("spatial_dropout.SpatialDropoutLayer", "{'phase': 'TEST', 'p': '0.2'}"), "Power",
          "power_param { scale: 1.25 }");
  becomes(python("triplet.l2norm_layer.L2NormLayer"), "Normalize",
          "normalize_param { normalize_type: 'L2' } norm_param { eps: 1e-36 }");
  expect_net(python("concat_layer.layer.PythonConcatLayer", "", "bottom: 'a' bottom: 'b'"),
             "layer { name: 'l/cropped' type: 'Crop' bottom: 'a' bottom: 'b' top: 'l/cropped' "
             "crop_param { offset: 0 } }"
             "layer { name: 'l' type: 'Concat' bottom: 'l/cropped' bottom: 'b' top: 't' }");
  for (const std::string& same :
       {python("other.darknet_reorg"), python("interp.UpsamplingBilinear2d", "{'zoom_factor':1.5}"),
        python("interp.UpsamplingBilinear2d", "{'zoom': 2}"),
        python("interp.UpsamplingBilinear2d", "{'zoom_factor': 2*2}"),
        python("spatial_dropout.SpatialDropoutLayer", "{'phase': 'TRAIN', 'p': '0.2'}"),
        python("spatial_dropout.SpatialDropoutLayer", "{'phase': 'TEST', 'p': '1'}")})
    EXPECT_TRUE(expect_net(same, same).empty());
}

/// pycaffe's callers reshape such inputs before they run the net.
TEST(InferenceNet, InputsOfRegionsHaveAllTheirNumbers) {
  const auto net = [](const std::string& type, int numbers, const std::string& between = "") {
    return str(
        "layer { name: 'i' type: 'Input' top: 'map' top: 'rows' input_param { shape { dim: "
        "[1, 8, 4, 4] } shape { dim: [1, ",
        numbers, "] } } }", between, "layer { name: 'p' type: '", type, "' bottom: 'map' ",
        type == "Proposal" ? "bottom: 'map' " : "", "bottom: 'rows' top: 't' }");
  };
  for (const auto& [type, numbers] :
       {std::pair{"ROIPooling", 5}, {"PSROIPooling", 5}, {"Proposal", 3}}) {
    const auto warnings = expect_net(net(type, numbers - 1), net(type, numbers));
    ASSERT_EQ(warnings.size(), 1U);
    EXPECT_HAS(warnings[0], str("input 'rows' has ", numbers, " numbers in a row"));
    for (const int other : {numbers, numbers - 2, numbers + 1})
      EXPECT_TRUE(expect_net(net(type, other), net(type, other)).empty());
  }
  const std::string written =
      net("ROIPooling", 4, "layer { type: 'ReLU' bottom: 'map' top: 'rows' }");
  EXPECT_TRUE(expect_net(written, written).empty());
}

/// Its settings are in no prototxt.
TEST(InferenceNet, FrcnnProposalHasSettingsOfFasterRcnn) {
  const std::string head =
                        "layer { name: 'p' type: 'FrcnnProposal' bottom: 's' bottom: 'o' bottom: "
                        "'i' top: 'r' ",
                    given = head + "proposal_param { anchor: [0, 0, 1, 1] } }";
  const auto warnings = expect_net(
      head + "}", head +
                      "proposal_param { feat_stride: 16 base_size: 16 min_size: 16 pre_nms_topn: "
                      "6000 post_nms_topn: 300 nms_thresh: 0.7 ratio: [0.5, 1, 2] scale: [8, "
                      "16, 32] } }");
  ASSERT_EQ(warnings.size(), 1U);
  EXPECT_HAS(warnings[0], "layer 'p' (FrcnnProposal) has no proposal_param");
  EXPECT_TRUE(expect_net(given, given).empty());
}

TEST(InferenceNet, OtherLayersInPythonStay) {
  const auto expect_same = [](const std::string& net) {
    EXPECT_TRUE(expect_net(net, net).empty());
  };
  for (const std::string odd :
       {"", "16", "'scales': [8]", "'feat_stride': 4,8,16", "'feat_stride': 16.5",
        "'feat_stride': 0", "'feat_stride': nan", "'feat_stride': [8, 16]", "'feat_stride': '16'",
        "'feat_stride': 16, 'scales': [8]", "{'feat_stride': 16", "{'feat_stride': 16}}",
        "{'feat_stride': 16, 'feat_stride': 8}", "{'feat_stride': 16, 'gradient_scale': 1}",
        "{'feat_stride': 16, 'scales': [8}", "'feat_stride: 16", "{'feat_stride': 16 # odd\\n}"})
    expect_same(python_proposal(odd));
  expect_same(python_proposal("'feat_stride': 16", "", "pylayer.proposal_layer"));
  expect_same(python_proposal("'feat_stride': 16", "bottom: 'more'"));
  expect_same(python_proposal("'feat_stride': 16", "top: 'scores' top: 'more'"));
  expect_same(python_proposal("'feat_stride': 16", "phase: TRAIN"));
  const std::string net = python_proposal("'feat_stride': 16");
  for (const NetReadOptions& options :
       {NetReadOptions{.keep_python = true}, NetReadOptions{.keep_training = true}})
    EXPECT_EQ(parse_net(net, "net", options).net.layer(0).type(), "Python");
}

TEST(InferenceNet, LayersOfForksThatReadDataBecomeInputs) {
  const std::string fc = "layer { name: 'fc' type: 'InnerProduct' bottom: 'data' top: 'fc' }";
  const std::string input = "layer { name: 'd' type: 'Input' top: 'data' ";
  const std::string shape = "input_param { shape { dim: [1, 3, 9, 9] } }";
  for (const char* layer :
       {"layer { name: 'd' type: 'Python' top: 'data' python_param { module: 'm' layer: 'L' } }",
        "layer { name: 'd' type: 'ImageDataRGB' top: 'data' image_data_param { a_field: 3 } }",
        "layer { name: 'd' type: 'MolGridData' top: 'data' }"})
    EXPECT_HAS(expect_net(layer + fc, input + "}" + fc).at(0), "is now the input 'data', of unkn");
  EXPECT_HAS(expect_net("layers { name: 'd' type: VIDEO_DATA top: 'data' top: 'label' } layers { "
                        "name: 'fc' type: INNER_PRODUCT bottom: 'data' top: 'fc' } layers { "
                        "type: SOFTMAX_LOSS bottom: 'fc' bottom: 'label' }",
                        input + "}" + fc +
                            "layer { name: 'prob' type: 'Softmax' bottom: 'fc' top: "
                            "'prob' }")
                 .at(0),
             "'d' (VideoData) is now the input 'data'");
  const std::string given = "layer { name: 'd' type: 'Data' top: 'data' " + shape + " }" + fc;
  EXPECT_HAS(expect_net(given, input + shape + "}" + fc).at(0), "1x3x9x9 (from its input_param)");
  EXPECT_EQ(
      parse_net("layer { name: 'd' type: 'Python' top: 'data' }", "net", {.keep_python = true})
          .net.layer(0)
          .type(),
      "Python");
}

TEST(InferenceNet, DataOfAnotherPhaseStaysIfNothingElseWritesIt) {
  const std::string fc = "layer { name: 'fc' type: 'InnerProduct' bottom: 'data' top: 'fc' }";
  const std::string train = " include { phase: TRAIN } }";
  const auto warnings =
      expect_net("layer { name: 'd' type: 'Data' top: 'data' top: 'unused'" + train + fc,
                 "layer { name: 'd' type: 'Input' top: 'data' }" + fc);
  EXPECT_HAS(warnings.at(0), "'d' (Data) is kept, although its rules drop it in phase TEST");
  expect_net("layer { name: 'd' type: 'Data' top: 'data' top: 'unused'" + train + kInput + fc,
             kInput + fc);
  const NetFile file =
      parse_net(kInput + "layer { name: 'r' type: 'ReLU' bottom: 'data' top: 'x'" + train +
                    "layer { name: 'fc' type: 'InnerProduct' bottom: 'x' top: 'fc' }",
                "net");
  Graph graph = resolve(file.net);
  graph.dropped = file.dropped;
  expect_error<InputError>([&] { prune(graph, "", ""); },
                           {"'x' is not written", "'r' (ReLU) writes it", "phase TEST"});
}

}  // namespace
}  // namespace revisit::proto
