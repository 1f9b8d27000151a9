#include "revisit/engine/net.h"

#include "caffe_schema.pb.h"
#include "cli/json.h"
#include "cli/terminal.h"
#include "reports.pb.h"
#include "revisit/proto/net_file.h"
#include "revisit/proto/npy.h"
#include "testing.h"

namespace revisit {
namespace {

constexpr const char* kNet = R"(name: "small"
layer { name: "data" type: "Input" top: "data" input_param { shape { dim: 1 dim: 1 dim: 4 dim: 4 } } }
layer { name: "conv1" type: "Convolution" bottom: "data" top: "conv1" convolution_param { num_output: 1 kernel_size: 1 } }
layer { name: "relu1" type: "ReLU" bottom: "conv1" top: "conv1" }
layer { name: "a/pool" type: "Pooling" bottom: "conv1" top: "a/pool" pooling_param { kernel_size: 2 stride: 2 } }
)";

constexpr const char* kWide =
    "input: 'data' input_shape { dim: [1, 64, 96, 96] } layer { name: 'c' type: 'Convolution' "
    "bottom: 'data' top: 'c' convolution_param { num_output: 64 kernel_size: 3 pad: 1 } } layer { "
    "name: 'p' type: 'Pooling' bottom: 'c' top: 'p' pooling_param { kernel_size: 2 stride: 2 } }";

class NetCommand : public testing::Test {
 protected:
  NetCommand() {
    write_file(dir_ / "net.prototxt", kNet);
    write_file(dir_ / "wide.prototxt", kWide);
    caffe::NetParameter net;
    caffe::LayerParameter& layer = *net.add_layer();
    layer.set_name("conv1");
    layer.set_type("Convolution");
    for (const float value : {2.0F, -1.0F}) {
      caffe::BlobProto& blob = *layer.add_blobs();
      for (int i = 0; i < (value > 0 ? 4 : 1); ++i) blob.mutable_shape()->add_dim(1);
      blob.add_data(value);
    }
    proto::write_net_binary(dir_ / "net.caffemodel", net);
    std::vector<float> values(16);
    for (size_t i = 0; i < values.size(); ++i) values[i] = static_cast<float>(i);
    proto::write_npy(dir_ / "in.npy", {1, 1, 4, 4}, values.data());
  }
  std::string path(const std::string& name) const { return (dir_ / name).string(); }
  std::string model() const { return path("net.prototxt") + " " + path("net.caffemodel"); }
  /// With the array of 4 x 4 numbers 0 to 15, into the folder out.
  std::string forward(const std::string& net, const std::string& more = "") const {
    return "net forward " + net + " --input data=" + path("in.npy") + " -o " + path("out") + more;
  }
  proto::Blob output(const std::string& name) const {
    return proto::read_npy(path("out/out_" + name + ".npy"));
  }
  reports::NetReport report_of(const std::string& command) const {
    write_file(dir_ / "report.json", run_ok(command + " --format json").out);
    reports::NetReport report;
    cli::read_report(dir_ / "report.json", &report);
    return report;
  }
  void expect_failure(int code, const std::string& arguments, const std::string& part) const {
    const auto result = run_revisit(arguments);
    EXPECT_EQ(result.exit_code, code) << arguments << "\n" << result.err;
    EXPECT_HAS(result.err, part);
    EXPECT_EQ(result.out, "");
  }

  const TempDir dir_;
};

TEST_F(NetCommand, ForwardWritesTheOutputs) {
  run_ok(forward(model()));
  const proto::Blob out = output("a_pool");
  EXPECT_EQ(out.shape, (std::vector<int64_t>{1, 1, 2, 2}));
  EXPECT_EQ(out.data, (std::vector<float>{9, 13, 25, 29}));  // 2 * max - 1
}

TEST_F(NetCommand, ForwardTakesTheShapeOfTheArrayAndCutsOff) {
  std::vector<float> values(15, 3);
  proto::write_npy(dir_ / "wide.npy", {1, 1, 3, 5}, values.data());
  run_ok("net forward " + model() + " --input " + path("wide.npy") + " --end conv1+a/pool -o " +
         path("out"));
  EXPECT_EQ(output("conv1+a_pool").shape, (std::vector<int64_t>{1, 1, 2, 3}));
}

TEST_F(NetCommand, ForwardAveragesSamplesOfASampledDropout) {
  write_file(dir_ / "drop.prototxt",
             "input: 'data' input_shape { dim: 1 dim: 1 dim: 4 dim: 4 } layer { name: 'drop' "
             "type: 'Dropout' bottom: 'data' top: 'out' dropout_param { dropout_ratio: 0.5 "
             "sample_weights_test: true } }");
  const auto dropped = [&](const std::string& options) {
    run_ok(forward(path("drop.prototxt"), options));
    return output("out").data;
  };
  const std::vector<float> one = dropped(""), mean = dropped(" --samples 2000");
  EXPECT_EQ(one, dropped(" --samples 1 --seed 0"));
  EXPECT_NE(one, dropped(" --seed 1"));
  for (size_t i = 0; i < one.size(); ++i) {
    const auto x = static_cast<float>(i);
    EXPECT_TRUE(one[i] == 0 || one[i] == 2 * x) << one[i];
    EXPECT_NEAR(mean[i], x, 0.1F * x);  // four deviations
  }
  expect_failure(2, "net forward " + path("drop.prototxt") + " -o o --samples 0", "--samples");
}

TEST_F(NetCommand, ForwardSubtractsMeans) {
  const std::string minus = forward(model(), " --mean ");
  const float five = 5;
  proto::write_npy(dir_ / "channel.npy", {1}, &five);
  run_ok(minus + path("channel.npy"));
  EXPECT_EQ(output("a_pool").data, (std::vector<float>{0, 3, 15, 19}));

  // A mean image of 6 x 6 with 1 in its center of 4 x 4, as Caffe keeps it.
  caffe::BlobProto image;
  image.set_num(1), image.set_channels(1), image.set_height(6), image.set_width(6);
  for (int y = 0; y < 6; ++y)
    for (int x = 0; x < 6; ++x) image.add_data(y > 0 && y < 5 && x > 0 && x < 5 ? 1 : 100);
  write_file(dir_ / "mean.binaryproto", image.SerializeAsString());
  run_ok(minus + "data=" + path("mean.binaryproto"));
  EXPECT_EQ(output("a_pool").data, (std::vector<float>{7, 11, 23, 27}));

  const std::vector<float> two(9, 2);
  proto::write_npy(dir_ / "small.npy", {1, 3, 3}, two.data());
  expect_failure(2, minus + path("small.npy"), "means of its channels: 2");
  proto::write_npy(dir_ / "three.npy", {3}, two.data());
  expect_failure(2, minus + path("three.npy"), "3 channels");
  proto::write_npy(dir_ / "flat.npy", {3, 3}, two.data());
  expect_failure(3, minus + path("flat.npy"), "found 3x3");

  run_ok(minus + "5");
  EXPECT_EQ(output("a_pool").data, (std::vector<float>{0, 3, 15, 19}));
  expect_failure(2, minus + "5,6", "the mean has 2 channels, the input is 1x1x4x4");
  for (const char* mean : {"5,,6", "5,", "''"})
    expect_failure(2, minus + mean, "--mean: expected a number, found ''");
  expect_failure(2, minus + "1e99", "--mean: 1e99 is out of range");
  expect_failure(3, minus + "none.npy", "none.npy: cannot open");
}

class ForwardOfPictures : public NetCommand {
 protected:
  ForwardOfPictures() {
    write_file(dir_ / "passes.prototxt",
               "input: 'data' input_shape { dim: [10, 3, 11, 17] } layer { name: 'out' type: "
               "'Power' bottom: 'data' top: 'out' }");
    write_file(dir_ / "three.txt", "n1 cat, tabby\r\ndog\nfish\n\n");
    write_file(
        dir_ / "means.prototxt",
        "input: 'data' input_shape { dim: [10, 3, 11, 17] } layer { name: 'out' type: 'Pooling' "
        "bottom: 'data' top: 'out' pooling_param { pool: AVE global_pooling: true } }");
  }
  static std::string picture(const std::string& name) {
    return " --input " + test::fixture("pictures/" + name).string();
  }
  std::vector<float> passed(const std::string& options) const {
    run_ok("net forward " + path("passes.prototxt") + " -o " + path("out") + options +
           picture("color.jpg"));
    return output("out").data;
  }
};

TEST_F(ForwardOfPictures, PixelsAreLessTheMeanThenScaledInTheOrderAskedFor) {
  const std::string bytes = read_file(test::fixture("pictures/color.jpg.bgr"));
  const std::vector<float> mean{104, 117.5, 123};
  const auto bgr = passed(" --mean 104,117.5,123 --input-scale 0.5"),
             rgb = passed(" --channels rgb --mean data=123,117.5,104 --input-scale 0.5");
  constexpr size_t kPlane = 11 * 17;
  ASSERT_EQ(bgr.size(), 3 * kPlane);
  for (size_t i = 0; i < kPlane; ++i)
    for (size_t c = 0; c < 3; ++c) {
      const float pixel = static_cast<uint8_t>(bytes[3 * i + c]);
      ASSERT_EQ(bgr[c * kPlane + i], (pixel - mean[c]) * 0.5F);
      ASSERT_EQ(rgb[(2 - c) * kPlane + i], (pixel - mean[c]) * 0.5F);
    }
}

TEST_F(ForwardOfPictures, TheBestClassesOfEachAreNamed) {
  const std::string means = "net forward " + path("means.prototxt") + picture("color.jpg") +
                            picture("gray.jpg") + " --labels " + path("three.txt");
  const auto result = run_ok(means);
  std::istringstream lines(result.out);
  std::vector<std::string> found;
  for (std::string line; std::getline(lines, line);) found.push_back(line);
  ASSERT_EQ(found.size(), 7U) << result.out;
  const std::string bytes = read_file(test::fixture("pictures/color.jpg.bgr"));
  double sums[3] = {};
  for (size_t i = 0; i < bytes.size(); ++i) sums[i % 3] += static_cast<uint8_t>(bytes[i]);
  const int best = static_cast<int>(std::max_element(sums, sums + 3) - sums);
  const std::string names[] = {"n1 cat, tabby", "dog", "fish"};
  EXPECT_TRUE(found[1].ends_with(names[best])) << result.out;
  EXPECT_TRUE(found[4].ends_with(names[0])) << "equal numbers: the first\n" << result.out;
  EXPECT_FALSE(fs::exists(path("out")));

  write_file(dir_ / "two.txt", "a\nb\n");
  write_file(dir_ / "no.txt", "\n");
  expect_failure(2, means + " --labels " + path("two.txt"),
                 "two.txt has 2 lines, but of each picture the output 'out' has 3 numbers");
  expect_failure(3, means + " --labels " + path("no.txt"),
                 "no.txt: expected a label per line, found none");
  expect_failure(3, means + " --labels " + path("none.txt"), "none.txt: cannot open");
}

TEST_F(ForwardOfPictures, RejectsMisuseOfPictures) {
  const std::string passes = "net forward " + path("passes.prototxt") + " -o " + path("out");
  expect_failure(3, passes + " --input none.png", "none.png: cannot open");
  expect_failure(2, passes + " --input dato=x.png", "did you mean 'data'");
  expect_failure(2, passes + " --input-scale 2", "needs a picture");
  expect_failure(2, passes + picture("color.jpg") + " --input-scale 0", "a positive number");
  expect_failure(2, passes + picture("color.jpg") + " --input-shape 1x2x4x4",
                 "the input 'data' is 1x2x4x4");
  expect_failure(2, passes + picture("color.jpg") + " -i " + path("in.npy"),
                 "has an array and a picture");
  expect_failure(2, "net forward " + model() + picture("gray.jpg"), "--output DIR or --labels");
}

TEST_F(NetCommand, ForwardAllWritesEachLayerAsItWas) {
  run_ok(forward(model(), " --all"));
  EXPECT_EQ(output("conv1").data[0], -1);
  EXPECT_EQ(output("relu1").data[0], 0);
  EXPECT_TRUE(fs::exists(path("out/out_data.npy")));
}

TEST_F(NetCommand, InspectNeedsNoWeights) {
  const auto table = run_ok("net inspect " + path("net.prototxt") + " --input-shape 1x1x100x200");
  EXPECT_HAS(table.out, "1x1x50x100");
  const auto json = run_ok("net inspect " + model() + " --format json");
  EXPECT_HAS(json.out, "\"parameters\": 2");
}

TEST_F(NetCommand, InspectTellsBottomsTopsAndTheShapesOfBlobs) {
  write_file(dir_ / "two.prototxt",
             std::string(kNet) +
                 "layer { name: 'fc' type: 'InnerProduct' bottom: 'a/pool' "
                 "top: 'fc' inner_product_param { num_output: 3 } } layer { "
                 "name: 'both' type: 'Concat' bottom: 'fc' bottom: 'fc' top: "
                 "'both' }");
  const reports::NetReport report =
      report_of("net inspect --input-shape 2,1,4,4 " + path("two.prototxt"));
  const auto text = [](const auto& list) {
    std::string all;
    for (const auto& item : list) {
      if constexpr (requires { item.name(); }) all += item.name() + " ";
      for (const int size : item.shape()) all += std::to_string(size) + ",";
      all += ";";
    }
    return all;
  };
  ASSERT_EQ(report.layers_size(), 6);
  EXPECT_EQ(text(report.layers(0).bottoms()), "");
  EXPECT_EQ(text(report.layers(0).tops()), "data 2,1,4,4,;");
  EXPECT_EQ(text(report.layers(1).blobs()), "1,1,1,1,;1,;");
  EXPECT_EQ(text(report.layers(2).bottoms()), "conv1 2,1,4,4,;");
  EXPECT_EQ(text(report.layers(2).tops()), "conv1 2,1,4,4,;");
  EXPECT_EQ(text(report.layers(4).blobs()), "3,4,;3,;");
  EXPECT_EQ(text(report.layers(5).bottoms()), "fc 2,3,;fc 2,3,;");
  EXPECT_EQ(text(report.layers(5).tops()), "both 2,6,;");
  EXPECT_EQ(text(report.layers(5).blobs()), "");
}

TEST_F(NetCommand, ProfilePrintsLayersAndTheWhole) {
  const auto json = run_revisit("net profile " + path("net.prototxt") +
                                " --input-shape 1x1x64x64 --threads 2 --repeat 3 --format json");
  EXPECT_EQ(json.exit_code, 0) << json.err;
  EXPECT_HAS(json.err, "note: no weights were given; random ones");
  for (const char* part : {"\"total_ms\"", "\"min\"", "\"median\"", "\"p95\"", "\"layers\"",
                           "\"kernel\": \"pointwise-gemm\"", "\"layer_sum_ms\"", "\"macs\": 4096"})
    EXPECT_HAS(json.out, part);
  const auto csv = run_revisit("net profile " + path("net.prototxt") + " --repeat 1 --format csv");
  EXPECT_EQ(std::count(csv.out.begin(), csv.out.end(), '\n'), 5);
  EXPECT_EQ(run_revisit("net profile " + model() + " --repeat 1").err.find("random"),
            std::string::npos);
}

TEST_F(NetCommand, ProfileShowsTheLimitsOfTheMachineAndABaseline) {
  const std::string profile = "net profile " + path("wide.prototxt");
  const reports::NetReport report = report_of(profile);
  const reports::NetLayer &convolution = report.layers(1), &pooling = report.layers(2);
  EXPECT_LE(convolution.multiplications(), convolution.macs());
  if (!report.has_busy()) {  // beside other tests
    EXPECT_GT(report.limits().float32_gflops(), 1);
    EXPECT_EQ(report.limits().threads(), 1);
    for (const double share : {convolution.peak_share(), pooling.memory_share()}) {
      EXPECT_GT(share, 0);
      EXPECT_LT(share, 2) << "beside other tests";
    }
  }
  EXPECT_FALSE(pooling.has_peak_share());
  EXPECT_LE(convolution.ms().low(), convolution.ms().median());
  EXPECT_GE(convolution.ms().high(), convolution.ms().median());

  const auto against = [&](double factor) {
    reports::NetReport old = report;
    for (reports::NetLayer& layer : *old.mutable_layers())
      for (const char* field : {"min", "median", "p95", "low", "high"}) {
        reports::Timing& ms = *layer.mutable_ms();
        const auto* const number = ms.GetDescriptor()->FindFieldByName(field);
        ms.GetReflection()->SetDouble(&ms, number,
                                      factor * ms.GetReflection()->GetDouble(ms, number));
      }
    write_file(dir_ / "old.json", cli::to_json(old));
    return run_revisit(profile + " --baseline " + path("old.json"));
  };
  const auto faster = against(100);
  EXPECT_EQ(faster.exit_code, 0) << faster.err;
  EXPECT_HAS(faster.out, "against " + path("old.json"));
  EXPECT_HAS(faster.out, "faster");
  EXPECT_HAS(against(0.01).out, "slower");
  expect_failure(3, profile + " --input-shape 1x64x96x97 --baseline " + path("old.json"),
                 "old.json: a profile of another net or input: input 1 is 'data' of 1x64x96x96");
  expect_failure(2, profile + " --repeat 7 --baseline " + path("old.json"), "at least 8");
  expect_failure(3, profile + " --baseline " + path("net.caffemodel"), "net.caffemodel");
}

TEST_F(NetCommand, AccuracyIsAnOptionAndItsRuleIsSaid) {
  const auto why = [&](const std::string& accuracy) {
    return run_revisit("net inspect --format json --accuracy " + accuracy + " " +
                       path("wide.prototxt"))
        .out;
  };
  EXPECT_HAS(why("default"), "\"fastest predicted\"");
  EXPECT_HAS(why("strict"), "\"strict accuracy\"");
  expect_failure(2, "net inspect --accuracy loose " + model(), "default or strict");
}

TEST_F(NetCommand, PrecisionIsAnOptionAndKernelsAreNamed) {
  write_file(dir_ / "two.prototxt",
             "input: 'data' input_shape { dim: [1, 64, 9, 9] } layer { name: 'c' type: "
             "'Convolution' bottom: 'data' top: 'c' convolution_param { num_output: 64 "
             "kernel_size: 1 } } layer { name: 'd' type: 'Convolution' bottom: 'c' top: 'd' "
             "convolution_param { num_output: 64 kernel_size: 1 } }");
  const std::string net = " " + path("two.prototxt") + " --repeat 1 --precision bf16";
  const auto table = run_ok("net profile" + net);
  EXPECT_TRUE(table.out.find("BF16") != std::string::npos ||
              table.out.find("AMX") != std::string::npos)
      << table.out;
  const std::string json = run_revisit("net profile --format json" + net).out;
  EXPECT_TRUE(json.find("\"pointwise bf16\"") != std::string::npos ||
              json.find("\"tiles bf16\"") != std::string::npos)
      << json;
  expect_failure(2, "net profile --precision half " + path("two.prototxt"), "float32 or bf16");
}

TEST_F(NetCommand, DenormalsAreKeptWhenAsked) {
  write_file(dir_ / "tiny.prototxt",
             "input: 'data' input_shape { dim: [1, 1, 4, 4] } layer { name: 'down' type: 'Power' "
             "bottom: 'data' top: 'down' power_param { scale: 1e-38 } } layer { name: 'half' type: "
             "'Power' bottom: 'down' top: 'half' power_param { scale: 0.0078125 } } layer { name: "
             "'up' type: 'Power' bottom: 'half' top: 'up' power_param { scale: 1e38 } }");
  const auto last = [&](const std::string& option) {
    run_ok(forward(path("tiny.prototxt"), option));
    return output("up").data.back();
  };
  EXPECT_EQ(last(""), 0);
  EXPECT_NEAR(last(" --accuracy strict"), 15 * 0.0078125, 1e-3);
}

TEST_F(NetCommand, RejectsMisuseWithKnownNames) {
  expect_failure(2, forward(model(), " --end conv2"), "did you mean 'conv1'");
  expect_failure(2, forward(model(), " --input dato=x.npy"), "did you mean 'data'");
  expect_failure(2, "net forward " + model() + " -o " + path("o"), "needs an array");
  expect_failure(2, "net inspect " + path("net.prototxt") + " --input-shape 1x1x", "1x1x");
  expect_failure(2, "net profile " + path("net.prototxt") + " --threads 0", "--threads");
  expect_failure(2, "net inspct", "did you mean 'inspect'");
  expect_failure(2, "net inspect", "PROTOTXT");
}

TEST_F(NetCommand, BadFilesAreExitCode3WithTheirPlaceAndUnsupportedLayers4) {
  write_file(dir_ / "odd.prototxt",
             std::string(kNet) +
                 "layer { name: \"odd\" type: \"Pythn\" bottom: \"a/pool\" top: \"odd\" }");
  expect_failure(4, "net inspect " + path("odd.prototxt"), "'odd' (Pythn)");
  run_ok("net inspect " + path("odd.prototxt") + " --end relu1");
  write_file(dir_ / "bad.prototxt", "name: \"x\"\nlayer {\n  name: \"a\" type \"ReLU\"\n}\n");
  write_file(dir_ / "corrupt.caffemodel", read_file(dir_ / "net.caffemodel").substr(0, 30));
  std::string other = kNet;
  other.replace(other.find("num_output: 1"), 13, "num_output: 3");
  write_file(dir_ / "other.prototxt", other);
  write_file(dir_ / "bad.npy", "not an array");
  ASSERT_EQ(mkfifo(path("pipe").c_str(), 0600), 0);
  for (const auto& [files, part] : {std::pair("bad.prototxt", "bad.prototxt:3:18:"),
                                    {"absent.prototxt", "absent.prototxt"},
                                    {"pipe", "is not a regular file"}})
    expect_failure(3, "net inspect " + path(files), part);
  expect_failure(3, "net inspect " + path("net.prototxt") + " " + path("corrupt.caffemodel"),
                 "corrupt.caffemodel");
  expect_failure(3, "net inspect " + path("other.prototxt") + " " + path("net.caffemodel"),
                 "another network");
  expect_failure(3, "net forward " + model() + " --input " + path("bad.npy") + " -o " + path("o"),
                 "bad.npy");
}

TEST_F(NetCommand, NetsThatEndInSilenceNeedAnEnd) {
  write_file(dir_ / "silent.prototxt",
             std::string(kNet) + "layer { type: 'Silence' bottom: 'a/pool' }");
  const std::string silent = path("silent.prototxt") + " " + path("net.caffemodel");
  expect_failure(2, forward(silent), "the net has no output: name the blob to output, with --end");
  run_ok(forward(silent, " --end a/pool"));
  run_ok(forward(silent, " --all"));
}

TEST_F(NetCommand, InspectCountsABatchAndTheFile) {
  const std::string text = run_ok("net inspect " + model() + " --input-shape 10x1x4x4").out;
  EXPECT_HAS(text, " GMACs for a batch of 10, ");
  EXPECT_HAS(text, " per image");
  EXPECT_EQ(run_ok("net inspect " + model()).out.find("batch"), std::string::npos);
  const std::string report = run_ok("net inspect --format json " + model()).out;
  EXPECT_HAS(report, str("\"weight_bytes_read\": ", fs::file_size(dir_ / "net.caffemodel")));
}

TEST_F(NetCommand, NamesOfFilesAndLayersStayAsTheyAreInMessages) {
  fs::rename(dir_ / "net.prototxt", dir_ / "Limits::layers");
  expect_failure(2, "net inspect --end LoadOptions::end " + path("Limits::layers"),
                 "end: the net 'small' has no layer or blob 'LoadOptions::end'");
  expect_failure(
      3, "net inspect --limit layers=3 " + path("Limits::layers"),
      "Limits::layers: has 4 layers, more than the limit of 3 (raise the limit of layers)");
}

TEST_F(NetCommand, LimitsAreOptions) {
  write_file(dir_ / "large", std::string((1 << 20) + 1, ' '));
  expect_failure(3, "net inspect --limit text=1 " + path("large"), "raise the limit of text");
  fs::resize_file(dir_ / "net.caffemodel", (1 << 20) + 1);
  expect_failure(3, "net inspect --limit weights=1 " + model(), "raise the limit of weights");
  expect_failure(2, "net inspect --limit layers=0 " + model(), "--limit layers: expected 1 to");
  expect_failure(3, "net inspect --limit run=1 --input-shape 1x1x900x900 " + path("net.prototxt"),
                 "limit of 1 MB (raise the limit of a run");
  // Values and packed weights share the limit: a kernel that packs less runs the layer.
  write_file(
      dir_ / "deep.prototxt",
      "input: 'data' input_shape { dim: [1, 1024, 14, 14] } layer { name: 'c' type: 'Convolution' "
      "bottom: 'data' top: 'c' convolution_param { num_output: 1024 kernel_size: 3 pad: 1 } }");
  const auto memory = [&](const std::string& option) {
    const reports::NetReport report = report_of("net inspect " + option + path("deep.prototxt"));
    return report.arena_bytes() + report.packed_weight_bytes();
  };
  EXPECT_GT(memory(""), 40 << 20);
  EXPECT_LE(memory("--limit run=10 "), 10 << 20);
}

TEST_F(NetCommand, AnInputWithoutAShapeTakesThatOfTheCommandLine) {
  std::string text = kNet;
  text.replace(text.find("layer { name: \"data\""),
               text.find("layer { name: \"conv1\"") - text.find("layer { name: \"data\""),
               "input: \"data\"\n");
  write_file(dir_ / "net.prototxt", text);
  expect_failure(3, "net inspect " + path("net.prototxt"),
                 "no shape for the input 'data'; give it in the prototxt or by an input shape");
  run_ok("net inspect --input-shape 1x1x4x4 " + model());
  run_ok(forward(model()));
}

TEST_F(NetCommand, TrainingNetsAndSolversRunAsInference) {
  write_file(dir_ / "train.prototxt",
             "layer { name: 'd' type: 'Data' top: 'data' top: 'label' "
             "data_param { batch_size: 1 } transform_param { scale: 0.5 } }"
             "layer { name: 'ip' type: 'InnerProduct' bottom: 'data' top: 'ip' "
             "inner_product_param { num_output: 2 } }"
             "layer { name: 'l' type: 'SoftmaxWithLoss' bottom: 'ip' bottom: 'label' }");
  write_file(dir_ / "solver.prototxt", "net: 'train.prototxt' base_lr: 0.1");
  expect_failure(3, "net inspect " + path("solver.prototxt"), "an input shape");
  const auto result = run_ok("net inspect " + path("solver.prototxt") + " --input-shape 1x3x4x4");
  EXPECT_HAS(result.out, "prob");
  for (const char* part : {"is a solver file", "is now the input 'data'", "scale 0.5", "'prob'"})
    EXPECT_HAS(result.err, part);
}

TEST_F(NetCommand, InspectShowsFieldsMemoryAndTheGraph) {
  const auto result =
      run_ok("net inspect " + path("net.prototxt") + " --memory --graph " + path("g.dot"));
  EXPECT_HAS(result.out, "2x2 /2,2 @0,0");  // a/pool
  EXPECT_HAS(result.out, "memory plan:");
  const std::string dot = read_file(path("g.dot"));
  EXPECT_HAS(dot, "\"a/pool\\nPooling\\n1x1x2x2\"");
  EXPECT_HAS(dot, "n2 -> n3");
  expect_failure(2, "net inspect " + path("net.prototxt") + " --graph " + path("g.pdf"), ".svg");
}

TEST_F(NetCommand, VerifyComparesWithTheOriginal) {
  const fs::path golden = dir_ / "case";
  fs::create_directories(golden);
  fs::copy_file(path("net.prototxt"), golden / "net.prototxt");
  fs::copy_file(path("net.caffemodel"), golden / "weights.caffemodel");
  fs::copy_file(path("in.npy"), golden / "in_data.npy");
  std::vector<float> right{9, 13, 25, 29}, after_relu(16);
  for (size_t i = 0; i < 16; ++i) after_relu[i] = std::max(0.0F, 2 * static_cast<float>(i) - 1);
  proto::write_npy(golden / "out_a_pool.npy", {1, 1, 2, 2}, right.data());
  proto::write_npy(golden / "out_conv1.npy", {1, 1, 4, 4},
                   after_relu.data());  // ReLU is in-place
  EXPECT_HAS(run_ok("net verify " + dir_.path().string()).out, "1 of 1 cases agree");

  right[3] = 28;
  proto::write_npy(golden / "out_a_pool.npy", {1, 1, 2, 2}, right.data());
  const auto bad = run_revisit("net verify " + golden.string());
  EXPECT_EQ(bad.exit_code, 5) << bad.out;
  EXPECT_HAS(bad.out, "FAILED");
  EXPECT_HAS(bad.out, "a/pool");
  // A slight error, in a net that does not amplify rounding.
  right[3] = 29 * (1 + 3e-5F);
  proto::write_npy(golden / "out_a_pool.npy", {1, 1, 2, 2}, right.data());
  EXPECT_EQ(run_revisit("net verify " + golden.string()).exit_code, 5);
  expect_failure(3, "net verify " + path("empty"), "empty");
}

TEST_F(NetCommand, DocumentsListTheLayerTypes) {
  const auto layers = run_ok("net inspect --layers --format csv");
  std::string markdown = "| type | from | does |\n|---|---|---|\n";
  for (const engine::LayerType& layer : engine::layer_types()) {
    markdown += str("| ", layer.type, " | ", layer.origin, " | ", layer.does, " |\n");
    EXPECT_HAS(layers.out, str("\n", layer.type, ",")) << layer.type;
  }
  const std::string page = read_file(test::project_file("docs/reference/LAYERS.md"));
  EXPECT_HAS(page, "--layers -->\n" + markdown + "<!-- end -->")
      << "docs/reference/LAYERS.md needs the lines:\n"
      << markdown;
}

TEST_F(NetCommand, UnwritableOutputIsExitCode1) {
  write_file(dir_ / "out", "");
  expect_failure(1, forward(model()), path("out"));
}

}  // namespace
}  // namespace revisit
