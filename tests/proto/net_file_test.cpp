#include "revisit/proto/net_file.h"

#include <google/protobuf/descriptor.pb.h>
#include <google/protobuf/util/message_differencer.h>

#include "revisit/base/text.h"
#include "testing.h"
#include "wire_bytes.h"

namespace revisit::proto {
namespace {

using namespace std::string_view_literals;
using google::protobuf::util::MessageDifferencer;

std::string parse_error(const std::string& text) {
  return message_of<InputError>([&] { parse_net(text, "net"); });
}

TEST(NetFile, ReadsText) {
  const NetFile file =
      parse_net("name: 'n' layer { name: 'a' type: 'ReLU' bottom: 'x' top: 'y' }", "net");
  ASSERT_EQ(file.net.layer_size(), 1);
  EXPECT_EQ(file.net.name(), "n");
  EXPECT_EQ(file.net.layer(0).type(), "ReLU");
  EXPECT_TRUE(file.warnings.empty());
}

TEST(NetFile, UnknownFieldGivesPositionOfItsNameAndNearestName) {
  EXPECT_EQ(
      parse_error("layer {\n  pooling_parm { }\n}"),
      "net:2:3: unknown field 'pooling_parm' in LayerParameter (did you mean 'pooling_param'?)");
  EXPECT_EQ(
      parse_error("layer { convolution_param { kernelsize: 3 } }"),
      "net:1:29: unknown field 'kernelsize' in ConvolutionParameter (did you mean 'kernel_size'?)");
  EXPECT_EQ(parse_error("layer { name: 'c' type: 'X' convolution_param { kernelsize: 3 } }"),
            "net:1:49: layer 'c' (X): unknown field 'kernelsize' in ConvolutionParameter (did you "
            "mean 'kernel_size'?)");
  EXPECT_EQ(parse_error("foo # x\n  : 1"),
            "net:1:1: unknown field 'foo' in NetParameter; "
            "allow unknown ignores it");
}

TEST(NetFile, UnknownFieldIsNotTakenForAnotherThatForksHave) {
  const std::string allow = "; allow unknown ignores it";
  EXPECT_EQ(parse_error("layer { correlation_param { } }"),
            "net:1:9: unknown field 'correlation_param' in LayerParameter (it is of FlowNet "
            "(lmb-freiburg/flownet2))" +
                allow);
  EXPECT_EQ(parse_error("layer { correlations_param { } }"),
            "net:1:9: unknown field 'correlations_param' in LayerParameter" + allow);
}

TEST(NetFile, FieldsWithoutEffectAreSaid) {
  const NetFile file = parse_net(
      "layer { name: 'c' type: 'Convolution' convolution_param {\n"
      "  num_output: 2 kernel_size: 3 engine: MKLDNN\n"
      "  weight_filler { type: 'msra' msra_coeff: 1.4 variance_norm: SOME } }\n"
      "  engine: 'MKL2017' multibox_loss_param { } param { lr_policy: 'x' } } engine: 'a'",
      "net");
  const std::string tail = "; it has no effect on results and is ignored";
  EXPECT_EQ(
      file.warnings,
      (std::vector<std::string>{
          "net:3:32: layer 'c' (Convolution): unknown field 'msra_coeff' in "
          "FillerParameter" +
              tail,
          "net:3:63: layer 'c' (Convolution): unknown value 'SOME' for variance_norm" + tail,
          "net:4:21: layer 'c' (Convolution): unknown field 'multibox_loss_param' in "
          "LayerParameter (it is of SSD (weiliu89/caffe))" +
              tail,
          "net:4:53: layer 'c' (Convolution): unknown field 'lr_policy' in ParamSpec" + tail}));
  EXPECT_EQ(file.net.layer(0).convolution_param().weight_filler().type(), "msra");
  EXPECT_EQ(file.net.layer(0).convolution_param().num_output(), 2U);
}

TEST(NetFile, FieldsThatMayChangeResultsAreNeverIgnored) {
  for (const char* text : {"layer { convolution_param { pad_type: 1 } }",
                           "layer { dummy_data_param { data_filler { offset: 1 } } }",
                           "layer { include { machine: 'x' } }"})
    for (const bool allow_unknown_fields : {false, true})
      expect_error<InputError>(
          [&] { parse_net(text, "net", {allow_unknown_fields}); },
          {"unknown field",
           "; it may change results, so no option ignores it; if it does not, remove it"});
}

/// SegNet's class weights change the value of SoftmaxWithLoss.
TEST(NetFile, FieldsOfALossMatterWhereTheLossRuns) {
  const auto parse = [](const std::string& type, const std::string& field) {
    return parse_net("layer { type: '" + type + "' " + field + " }", "net",
                     {.allow_unknown_fields = true});
  };
  for (const char* field : {"loss_param { class_weighting: 2 }",
                            "loss_param { normalization: ODD }", "focal_loss_param { }"}) {
    SCOPED_TRACE(field);
    for (const char* type : {"SoftmaxWithLoss", "EuclideanLoss"})
      EXPECT_THROW(parse(type, field), InputError) << type;
    const auto warnings = parse("HingeLoss", field).warnings;
    ASSERT_EQ(warnings.size(), 1U);
    EXPECT_TRUE(warnings[0].ends_with("it has no effect on results and is ignored")) << warnings[0];
  }
  EXPECT_THROW(parse_net("layers { type: SOFTMAX_LOSS loss_param { class_weighting: 2 } }", "net"),
               InputError);
  const std::string data = "layer { name: 'd' type: 'Data' top: 'x' top: 'l' } ",
                    loss = "layer { name: 's' type: 'SoftmaxWithLoss' bottom: 'x' bottom: 'l' ";
  EXPECT_EQ(
      parse_net(data + loss + "loss_param { class_weighting: 2 } }", "net").net.layer(1).type(),
      "Softmax");
  EXPECT_THROW(parse_net(data + loss + "softmax_param { odd: 2 } }", "net"), InputError);
}

TEST(NetFile, FieldsThatMeanKnownOnesAreNeverIgnored) {
  const auto error = [](const std::string& text) {
    return message_of<InputError>([&] { parse_net(text, "net", {.allow_unknown_fields = true}); });
  };
  EXPECT_EQ(error("layer { type: 'Softmax' sofmax_param { axis: 2 } }"),
            "net:1:25: unknown field 'sofmax_param' in LayerParameter (did you mean "
            "'softmax_param'?)");
  EXPECT_EQ(
      error("layer { name: 's' type: 'Softmax' axis: 2 odd_param { } }"),
      "net:1:35: layer 's' (Softmax): unknown field 'axis' in LayerParameter (did you mean it "
      "in 'softmax_param'?)");
  EXPECT_EQ(error("layers { num_output: 2 }"),
            "net:1:10: unknown field 'num_output' in V1LayerParameter (did you mean it in "
            "'convolution_param'?)");
  EXPECT_EQ(error("lyr { name: 's' }"),
            "net:1:1: unknown field 'lyr' in NetParameter; it may change results, so no option "
            "ignores it; if it does not, remove it from the file");
  EXPECT_EQ(parse_net("odd: 1 layer { mil_param { } odd: 2 [my.ext]: 3 }", "net",
                      {.allow_unknown_fields = true})
                .warnings.size(),
            4U);
}

/// NVIDIA's fork uses other data types and algorithms.
TEST(NetFile, FieldsThatSayHowToComputeAreIgnored) {
  const NetFile file = parse_net(
      "default_forward_type: FLOAT16 default_backward_math: FLOAT default_cudnn_math_override: 0\n"
      "layer { type: 'Convolution' forward_math: FLOAT16 convolution_param { "
      "conv_algos_override: '1,1,1' cudnn_flavor: MIN_MEMORY } }",
      "net");
  ASSERT_EQ(file.warnings.size(), 3U);
  EXPECT_EQ(file.warnings[2],
            "net:2:29: unknown field 'forward_math' in LayerParameter (a data type of NVIDIA's "
            "fork; all types "
            "are FLOAT here); it has no effect on results and is ignored");
}

TEST(NetFile, LayersThatAreLeftOutMayHaveAnyFields) {
  const NetFile file = parse_net(
      "layer { type: 'Data' top: 'x' data_param { shuffle: true } transform_param { "
      "resize_param { height: abc } } annotated_data_param { } odd_param { } }\n"
      "layer { type: 'ReLU' bottom: 'x' top: 'y' include { phase: TRAIN } relu_param { odd: 1 } }\n"
      "layer { name: 'r' type: 'ReLU' bottom: 'x' top: 'y' }",
      "net");
  ASSERT_EQ(file.net.layer_size(), 2);
  EXPECT_EQ(file.net.layer(1).name(), "r");
}

TEST(NetFile, LeavesUnparsedLayersToTheCaller) {
  const NetFile file =
      parse_net("layer { name: 'a' } layer { name: 'b' relu_param { negative_slope: } }", "net",
                {.keep_unread = true});
  EXPECT_EQ(file.net.layer_size(), 2);
}

TEST(NetFile, OldLayersOfForksHaveTheirTypes) {
  const NetFile file = parse_net(
      "layers { name: 'i' type: INTERP interp_param { height: 5 } } layers { type: UPSAMPLE }",
      "net");
  EXPECT_EQ(file.net.layer(0).type(), "Interp");
  EXPECT_EQ(file.net.layer(0).interp_param().height(), 5);
  EXPECT_EQ(file.net.layer(1).type(), "Upsample");
}

TEST(NetFile, ColumnsCountBytesNotTabStops) {
  EXPECT_EQ(parse_error("layer {\r\n\t\tbotom: 'x'\r\n}"),
            "net:2:3: unknown field 'botom' in LayerParameter (did you mean 'bottom'?)");
  EXPECT_EQ(parse_error("layer {\n\ta\t: 1\n}"),
            "net:2:2: unknown field 'a' in LayerParameter; allow unknown "
            "ignores it");
}

TEST(NetFile, SolverTextIsRecognized) {
  EXPECT_EQ(parse_error("net: \"train.prototxt\"\nbase_lr: 0.1"),
            "net:1:1: unknown field 'net' in NetParameter (is this a solver file? give the net it "
            "names)");
}

TEST(NetFile, UnknownEnumValueGivesNearest) {
  EXPECT_EQ(parse_error("layer {\n pooling_param { pool: max } }"),
            "net:2:24: unknown value 'max' for pool (did you mean 'MAX'?)");
  EXPECT_EQ(parse_error("layers { type: CONVOLUTON }"),
            "net:1:16: unknown value 'CONVOLUTON' for type (did you mean 'CONVOLUTION'?)");
}

TEST(NetFile, RepeatedScalarGivesPositionOfItsSecondName) {
  EXPECT_EQ(parse_error("layer {\n name: 'a'\n name: 'b' }"),
            "net:3:2: layer 'a': Non-repeated field \"name\" is specified multiple times.");
}

TEST(NetFile, TextThatEndsTooEarly) {
  EXPECT_EQ(parse_error("layer {\n  name: 'x'"),
            "net:2:12: Expected identifier, got: the end of the text");
}

TEST(NetFile, MissingRequiredFieldGivesPositionOfItsMessage) {
  EXPECT_EQ(parse_error("layer { name: 'a' }\nlayer {\n  clip_param { max: 1 }\n}"),
            "net:3:3: missing required field clip_param.min");
}

TEST(NetFile, UnknownFieldsCanBeWarnings) {
  const NetFile file =
      parse_net("layer { name: 'a'\n  correlation_param { height: [ 3, 4 ] pad < > } top: 'b' }",
                "net", {.allow_unknown_fields = true});
  ASSERT_EQ(file.warnings.size(), 1U);
  EXPECT_EQ(
      file.warnings[0],
      "net:2:3: layer 'a': unknown field 'correlation_param' in LayerParameter (it is of FlowNet "
      "(lmb-freiburg/flownet2)); it is ignored");
  EXPECT_EQ(file.net.layer(0).top(0), "b");
}

TEST(NetFile, DeepNestingIsAnErrorNotACrash) {
  std::string text = "x ";
  for (int i = 0; i < 300'000; ++i) text += "{ a ";
  const std::string brackets = "x: " + std::string(1'000'000, '[');
  for (const std::string& deep : {text, brackets}) {
    const auto parse = [&] { parse_net(deep, "net", {.allow_unknown_fields = true}); };
    EXPECT_HAS(message_of<InputError>(parse), "recursion limit");
  }
}

TEST(NetFile, ByteOrderMarkIsRejectedAsInCaffe) {
  EXPECT_HAS(parse_error("\xEF\xBB\xBFlayer { }"), "net:1:1: starts with a byte order mark");
}

TEST(NetFile, NoLayersAtAll) {
  EXPECT_EQ(parse_error(""), "net: is empty, expected a prototxt (text)");
  EXPECT_EQ(parse_error("# nothing\n"), "net: describes no layers");
}

TEST(NetFile, ThingsThatAreNoPrototxt) {
  const TempDir dir;
  const auto error = [](const fs::path& file) {
    return message_of<InputError>([&] { read_net(file); });
  };
  EXPECT_EQ(error(dir / "none"),
            (dir / "none").string() + ": cannot open: No such file or directory");
  EXPECT_EQ(error(dir.path()), dir.path().string() + ": is a folder, expected a file");

  caffe::NetParameter net;
  net.set_name("n");
  net.add_layer()->set_name("conv1");
  write_net_binary(dir / "w", net);
  EXPECT_EQ(error(dir / "w"),
            (dir / "w").string() + ": looks like a binary caffemodel, expected a prototxt (text)");
  write_file(dir / "h5", "\x89HDF\r\n\x1a\n");
  EXPECT_HAS(error(dir / "h5"), "looks like an HDF5 weights file");
}

TEST(NetFile, LimitsAreNamedWithTheOptionThatRaisesThem) {
  const TempDir dir;
  write_file(dir / "large", std::string((16 << 20) + 1, ' '));
  expect_error<InputError>([&] { read_net(dir / "large"); },
                           {"is larger than 16 MB", "limit of text"});
  expect_error<InputError>([&] { read_net(dir / "large", {.limits = {.text_bytes = 5}}); },
                           {"is larger than 0 MB", "limit of text"});
  EXPECT_HAS(message_of<InputError>(
                 [&] { read_net(dir / "large", {.limits = {.text_bytes = 17 << 20}}); }),
             "describes no layers");

  std::string many;
  for (int i = 0; i <= 20'000; ++i) many += "layer{}";
  expect_error<InputError>([&] { parse_net(many, "net"); },
                           {"net: has 20001 layers", "limit of 20000", "limit of layers"});
  // Parsed, so many messages would take gigabytes.
  expect_error<InputError>([&] { parse_net("layer{" + std::string(15 << 20, '<'), "net"); },
                           {"net: has more than 320000 pairs of braces", "limit of layers"});
}

TEST(NetFile, TextAndBinaryRoundTrip) {
  const NetFile file = parse_net(
      "name: \"a\\\"\\n\\001\"\nlayer { name: 'c' type: 'Power' power_param { scale: 0.1 shift: "
      "-inf } }",
      "net");
  const TempDir dir;
  write_net_text(dir / "t", file.net);
  EXPECT_TRUE(MessageDifferencer::Equals(read_net(dir / "t").net, file.net));
  write_net_binary(dir / "b", file.net);
  caffe::NetParameter back;
  ASSERT_TRUE(back.ParseFromString(read_file(dir / "b")));
  EXPECT_TRUE(MessageDifferencer::Equals(back, file.net));
}

TEST(NetFile, WritingSaysWhyItCannot) {
  caffe::NetParameter net;
  net.add_layer()->mutable_clip_param()->set_min(0);
  const TempDir dir;
  EXPECT_HAS(message_of<Error>([&] { write_net_text(dir / "t", net); }), "layer[0].clip_param.max");
  EXPECT_FALSE(fs::exists(dir / "t"));
  net.Clear();
  EXPECT_HAS(message_of<Error>([&] { write_net_binary(dir.path() / "no" / "b", net); }),
             "cannot create");
}

TEST(NetFileRobustness, DamagedTextIsAnErrorOrANet) {
  const std::string whole =
      "input: 'x' input_dim: 1 input_dim: 2 input_dim: 3 input_dim: 4\n"
      "layers { layer { name: 'q' type: 'padding' pad: 2 } bottom: 'x' top: 'q' }\n"
      "layers { layer { name: 'c' type: 'conv' kernelsize: 3 blobs_lr: 1. } bottom: 'q' top: 'c' "
      "}\n";
  int n_errors = 0;
  const auto read = [&](const std::string& text) {
    for (const bool allow_unknown_fields : {false, true}) {
      try {
        const NetFile file = parse_net(text, "net", {allow_unknown_fields});
        EXPECT_EQ(file.net.layers_size() + file.net.input_size(), 0);
      } catch (const InputError& error) {
        ++n_errors;
        EXPECT_TRUE(std::string(error.what()).starts_with("net:")) << error.what();
      }
    }
  };
  const std::string_view telling_bytes = "\0\n\t #'\"{}[]<>:,;-09.aex\x80\xff"sv;
  for (size_t at = 0; at < whole.size(); ++at) {
    read(whole.substr(0, at));
    for (const char byte : telling_bytes) {
      std::string damaged = whole;
      damaged[at] = byte;
      read(damaged);
      read(whole.substr(0, at) + byte + whole.substr(at));
    }
  }
  EXPECT_GT(n_errors, 1000);
}

TEST(NetFile, BytesReadBack) {
  const NetFile file = parse_net("name: 'n' layers { name: 'a' type: RELU bottom: 'x' top: 'y' }",
                                 "net", {.keep_training = true});
  const TempDir dir;
  write_file(dir / "net", net_bytes(file.net));
  const NetFile again = read_net_binary(dir / "net");
  EXPECT_TRUE(MessageDifferencer::Equals(file.net, again.net));
}

TEST(NetFile, BytesThatAreNoNetAreRefused) {
  const TempDir dir;
  for (const std::string_view bytes :
       {""sv, "\xff\xff\xff"sv, "\x89HDF\r\n\x1a\n"sv, "name: 'n'"sv}) {
    write_file(dir / "bytes", std::string(bytes));
    const std::string message = message_of<InputError>([&] { read_net_binary(dir / "bytes"); });
    EXPECT_TRUE(message.starts_with((dir / "bytes").string())) << message;
  }
}

TEST(NetFile, TheSchemaIsAFileDescriptor) {
  google::protobuf::FileDescriptorProto schema;
  ASSERT_TRUE(schema.ParseFromString(schema_bytes()));
  EXPECT_EQ(schema.package(), "revisit.caffe");
  EXPECT_TRUE(std::ranges::any_of(
      schema.message_type(), [](const auto& message) { return message.name() == "NetParameter"; }));
}

TEST(NetFile, FieldsWithoutEffectAndOfQuantization) {
  const std::string net =
      "eltwise_mem_sharing: false mem_param { optimize_test: true } layer { name: 'c' type: 'ReLU' "
      "strict_dim: false quantization_param { bw_layer_in: 8 } }";
  const NetFile file = parse_net(net, "net");
  ASSERT_EQ(file.warnings.size(), 4U);
  for (const char* part : {"eltwise_mem_sharing", "mem_param", "strict_dim"})
    EXPECT_HAS(joined(file.warnings, "\n"), part);
  EXPECT_HAS(joined(file.warnings, "\n"), "the layer is computed in float32");
}

TEST(NetFile, WrongDownloadsAndTruncatedFilesAreNamed) {
  for (const auto& [text, part] : std::vector<std::pair<std::string, std::string>>{
           {"<!DOCTYPE html>\n<html></html>", "net: is a web page; download the file itself"},
           {"version https://git-lfs.github.com/spec/v1\noid sha256:1\n", "is a Git LFS pointer"},
           {"layers { type: INTERP }\nlayers {\n", "net:3:1: is not closed or not well-formed"}})
    expect_error<InputError>([&] { parse_net(text, "net"); }, {part});
}

/// Forks give the number 149 to other types; the engine's reader skips it.
TEST(NetFile, FieldsOfOtherForksInBinaryNetsAreSkipped) {
  const TempDir dir;
  const std::string layer = bytes_field(1, "c") + bytes_field(149, "Ternary");
  write_file(dir / "n", bytes_field(1, "n") + bytes_field(100, layer) + bytes_field(2, "\x22\1v"));
  expect_error<InputError>([&] { read_net_binary(dir / "n"); }, {"both V1 `layers` and V2"});
  write_file(dir / "n", bytes_field(1, "n") + bytes_field(100, layer));
  const NetFile file = read_net_binary(dir / "n");
  EXPECT_EQ(file.net.layer(0).name(), "c");
  EXPECT_HAS(file.warnings.at(0), "layer 'c': skipped the fields 149");
  EXPECT_EQ(readable_net(bytes_field(100, layer)), bytes_field(100, bytes_field(1, "c")));
  expect_error<InputError>([&] { readable_net("\xff"); }, {"cannot parse"});
}

}  // namespace
}  // namespace revisit::proto
