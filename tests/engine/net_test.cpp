#include "caffe_schema.pb.h"
#include "net_case.h"
#include "revisit/proto/net_file.h"
#include "testing.h"

namespace revisit::engine {
namespace {

/// y = relu(2 x + 1), then x1 and x2 from it.
constexpr const char* kNet = R"(
  name: "small"
  layer { name: "data" type: "Input" top: "data" input_param { shape { dim: 1 dim: 1 dim: 2 dim: 3 } } }
  layer { name: "conv" type: "Convolution" bottom: "data" top: "conv" convolution_param { num_output: 1 kernel_size: 1 } }
  layer { name: "relu" type: "ReLU" bottom: "conv" top: "conv" }
  layer { name: "drop" type: "Dropout" bottom: "conv" top: "conv" }
  layer { name: "pool" type: "Pooling" bottom: "conv" top: "pool" pooling_param { kernel_size: 1 } }
  layer { name: "concat" type: "Concat" bottom: "conv" bottom: "pool" top: "concat" }
)";

class NetTest : public testing::Test {
 protected:
  NetTest() {
    write_file(prototxt(), kNet);
    write_weights("conv", {1, 1, 1, 1}, {2}, {1});
  }
  std::filesystem::path prototxt() const { return dir_ / "net.prototxt"; }
  std::filesystem::path weights() const { return dir_ / "net.caffemodel"; }

  void write_weights(const std::string& layer, const std::vector<int64_t>& shape,
                     const std::vector<float>& w, const std::vector<float>& b) {
    caffe::NetParameter net;
    caffe::LayerParameter& param = *net.add_layer();
    param.set_name(layer);
    param.set_type("Convolution");
    caffe::BlobProto& blob = *param.add_blobs();
    for (const int64_t size : shape) blob.mutable_shape()->add_dim(size);
    blob.mutable_data()->Add(w.begin(), w.end());
    caffe::BlobProto& bias = *param.add_blobs();
    bias.mutable_shape()->add_dim(static_cast<int64_t>(b.size()));
    bias.mutable_data()->Add(b.begin(), b.end());
    proto::write_net_binary(weights(), net);
  }

  const TempDir dir_;
};

std::vector<float> forward(engine::Run& run, const std::vector<float>& input,
                           const std::string& output) {
  std::copy(input.begin(), input.end(), run.input("data").data);
  run.forward();
  const auto values = run.output(output).values();
  return {values.begin(), values.end()};
}

std::vector<float> of_layer(const engine::Run& run, const std::string& layer) {
  const auto values = run.layer_output(layer).values();
  return {values.begin(), values.end()};
}

TEST_F(NetTest, ComputesAndCanRunAgain) {
  const Net net = Net::load(prototxt(), weights());
  engine::Run run(net.plan());
  const std::vector<float> once{0, 3, 0, 7, 0, 11}, twice{0, 3, 0, 7, 0, 11, 0, 3, 0, 7, 0, 11};
  EXPECT_EQ(forward(run, {-1, 1, -2, 3, -3, 5}, "concat"), twice);
  EXPECT_EQ(forward(run, {0, 0, 0, 0, 0, 0}, "concat"), std::vector<float>(12, 1));
  run.forward();  // the input keeps its values
  EXPECT_EQ(run.output("concat").values()[0], 1);
}

TEST_F(NetTest, EveryLayersOutputIsItsOwn) {
  const Net net = Net::load(prototxt(), weights());
  engine::Run run(net.plan({}, {.keep_all = true}));
  forward(run, {-1, 1, -2, 3, -3, 5}, "concat");
  EXPECT_EQ(of_layer(run, "conv"), (std::vector<float>{-1, 3, -3, 7, -5, 11}));
  EXPECT_EQ(of_layer(run, "relu")[0], 0);
  EXPECT_EQ(of_layer(run, "drop")[0], 0);
}

TEST_F(NetTest, OutputsThatAreNotKeptAreRefused) {
  const Net net = Net::load(prototxt(), weights());
  const engine::Run run(net.plan());
  expect_error<UsageError>([&] { run.output("conv"); }, {"keeps no output 'conv'"});
  expect_error<UsageError>([&] { run.layer_output("conv"); }, {"keeps no output of a layer"});
  expect_error<UsageError>([&] { engine::Run(net.plan()).input("dat"); }, {"did you mean 'data'"});
}

TEST_F(NetTest, AnyInputSizeAndBatch) {
  const Net net = Net::load(prototxt(), weights());
  const Plan plan = net.plan({{"data", Shape{3, 1, 5, 7}}});
  EXPECT_EQ(plan.outputs()[0].shape, (Shape{3, 2, 5, 7}));
  expect_error<UsageError>([&] { net.plan({{"dota", Shape{1}}}); }, {"did you mean 'data'"});
  expect_error<InputError>(
      [&] {
        net.plan({{"data", Shape{1, 2, 3, 3}}});
      },
      {"'conv'", "blob 0", "1x2x1x1"});
}

TEST_F(NetTest, MemoryIsSharedOverTime) {
  const Plan plan = Net::load(prototxt(), weights()).plan({{"data", Shape{1, 1, 64, 64}}});
  EXPECT_EQ(plan.layers()[2].activation_bytes, 0);  // the ReLU works in place
  EXPECT_EQ(plan.layers()[3].activation_bytes, 0);  // Dropout is a view
  using test::conv;
  const Plan chain = test::small_net({1, 16, 64, 64}, conv("a", "data") + conv("b", "a") +
                                                          conv("c", "b") + conv("d", "c"))
                         .plan({}, {.reference_kernels = true});
  int64_t all = 0;
  for (const LayerCost& layer : chain.layers()) all += layer.activation_bytes;
  EXPECT_EQ(all, (16 + 4 * 32) * 64 * 64 * 4);
  // The input stays; at most two other buffers are live. The reference kernel lists the nine pixels
  // under its window: one cache line of scratch.
  EXPECT_EQ(chain.arena_bytes(), (16 + 2 * 32) * 64 * 64 * 4 + 64);
}

TEST_F(NetTest, StridesBeyondAllUseTakeNoMemory) {
  // The input row under a tile of such windows, times kernel rows and threads, overflows.
  const Net net = test::small_net(
      {1, 1, 1, 1}, test::conv("c", "data",
                               "num_output: 8 kernel_h: 81000 kernel_w: 1 stride_h: 1 "
                               "stride_w: 2147483647 pad_h: 40500 pad_w: 0"));
  const Plan plan = net.plan({}, {.threads = 1024});
  EXPECT_GT(plan.arena_bytes(), 0);
  EXPECT_LT(plan.arena_bytes(), int64_t{1} << 30);
}

TEST_F(NetTest, TooMuchMemoryIsRefusedBeforeItIsAllocated) {
  const Net net = Net::load(prototxt(), weights());
  const Shape large{1, 1, 1000, 1000};  // 4 MB; outputs "concat" 8 MB
  expect_error<InputError>(
      [&] {
        net.plan({{"data", large}}, {.max_run_bytes = int64_t{7} << 20});
      },
      {"'concat'", "outputs take 7 MB", "limit of 7 MB", "the limit of a run"});
  expect_error<InputError>(
      [&] {
        net.plan({{"data", large}}, {.max_run_bytes = int64_t{9} << 20});
      },
      {"running the net takes", "limit of 9 MB", "largest buffer is of 'concat': 7 MB"});
  EXPECT_GT(net.plan({{"data", large}}).arena_bytes(), int64_t{9} << 20);
  const auto load = [&](int64_t bytes) {
    Net::load_with_random_weights(prototxt(), 1, {.limits = {.weight_bytes = bytes}});
  };
  expect_error<InputError>([&] { load(7); }, {"'conv' (Convolution)", "limit of weights"});
  load(8);
}

TEST_F(NetTest, OtherNumbersOfThreadsAreRefused) {
  const Net net = Net::load(prototxt(), weights());
  expect_error<UsageError>([&] { net.plan({}, {.threads = 2'000'000'000}); }, {"at most 1024"});
  for (const int threads : {0, -1})
    expect_error<UsageError>([&] { net.plan({}, {.threads = threads}); },
                             {"at least 1", std::to_string(threads)});
}

TEST_F(NetTest, AnInputWithoutAShapeTakesThatOfTheOptions) {
  write_file(prototxt(), R"(input: "data"
    layer { name: "c" type: "Convolution" bottom: "data" top: "c"
            convolution_param { num_output: 2 kernel_size: 3 } })");
  expect_error<InputError>([&] { Net::load_without_weights(prototxt()); },
                           {"net.prototxt: layer 'input' (Input)",
                            "the file gives no shape for the input 'data'", "an input shape"});
  const Net net = Net::load_without_weights(prototxt(), {.inputs = {{"data", {1, 3, 8, 8}}}});
  EXPECT_EQ(net.plan().outputs()[0].shape, (Shape{1, 2, 6, 6}));
  EXPECT_EQ(net.plan({{"data", {2, 3, 9, 8}}}).outputs()[0].shape, (Shape{2, 2, 7, 6}));
  EXPECT_EQ(input_blobs(prototxt()), std::vector<std::string>{"data"});
  EXPECT_TRUE(net.warnings().empty());
}

TEST_F(NetTest, LayersWithWeightsAreNotGrafted) {
  expect_error<UsageError>(
      [&] { Net::load(prototxt(), weights(), {.end = "pool", .graft = "conv"}); },
      {"net.prototxt", "graft: layer", "'conv' (Convolution) has weights"});
  EXPECT_NO_THROW(Net::load(prototxt(), weights(), {.end = "conv", .graft = "pool"}));
}

TEST_F(NetTest, AGraftBeforeAReluIsAWarningOfTheNet) {
  write_file(prototxt(), R"(
    layer { name: "d" type: "Input" top: "d" input_param { shape { dim: 1 dim: 1 dim: 4 dim: 4 } } }
    layer { name: "p" type: "Pooling" bottom: "d" top: "p" pooling_param { kernel_size: 2 } }
    layer { name: "r" type: "ReLU" bottom: "p" top: "r" }
    layer { name: "s" type: "Eltwise" bottom: "p" bottom: "r" top: "s" })");
  const Net net = Net::load_without_weights(prototxt(), {.end = "p", .graft = "p"});
  ASSERT_EQ(net.warnings().size(), 1U);
  EXPECT_HAS(net.warnings()[0], "'p+p' is grafted onto 'p' before the ReLU 'r'");
}

TEST_F(NetTest, WeightsOfAnotherNetworkAreRefused) {
  write_weights("conv", {1, 3, 1, 1}, {1, 2, 3}, {0});
  expect_error<InputError>([&] { Net::load(prototxt(), weights()); },
                           {"'conv'", "blob 0", "1x1x1x1", "1x3x1x1", "another network"});
  write_weights("fc6", {1, 1, 1, 1}, {1}, {0});
  expect_error<InputError>([&] { Net::load(prototxt(), weights()); },
                           {"no weights", "conv", "fc6"});
  const Net net = Net::load(prototxt(), weights(), {.allow_missing = true});
  EXPECT_EQ(net.warnings().size(), 2U);
}

TEST_F(NetTest, WeightsWithoutANameAreAnInputError) {
  expect_error<InputError>([&] { Net::load(prototxt(), ""); }, {"cannot open"});
}

TEST_F(NetTest, NamedParametersAreShared) {
  // Two layers share weight and bias; the file has them for the first only (as HDF5 does), or for
  // both.
  write_file(prototxt(), R"(
    layer { name: "data" type: "Input" top: "data" input_param { shape { dim: 1 dim: 1 dim: 1 dim: 2 } } }
    layer { name: "conv" type: "Convolution" bottom: "data" top: "a" param { name: "w" } param { name: "b" }
            convolution_param { num_output: 1 kernel_size: 1 } }
    layer { name: "twin" type: "Convolution" bottom: "a" top: "b" param { name: "w" } param { name: "b" }
            convolution_param { num_output: 1 kernel_size: 1 } }
    layer { name: "branch" type: "Convolution" bottom: "data" top: "c" param { name: "w" } param { name: "b" }
            convolution_param { num_output: 1 kernel_size: 1 } })");
  {
    engine::Run run(Net::load(prototxt(), weights()).plan());
    EXPECT_EQ(forward(run, {1, 2}, "b"), (std::vector<float>{7, 11}));  // 2 (2 x + 1) + 1
  }
  // The owner is truncated, but its weights are read for the layer that shares them.
  engine::Run run(Net::load(prototxt(), weights(), {.end = "branch"}).plan());
  EXPECT_EQ(forward(run, {1, 2}, "branch"), (std::vector<float>{3, 5}));
}

constexpr const char* kTwins = R"(
  layer { name: "data" type: "Input" top: "data" input_param { shape { dim: 1 dim: 1 } } }
  layer { name: "twin" type: "InnerProduct" bottom: "data" top: "a" inner_product_param { num_output: 1 bias_term: false } }
  layer { name: "twin" type: "InnerProduct" bottom: "data" top: "b" inner_product_param { num_output: 1 bias_term: false } PARAM }
  layer { name: "cut" type: "Power" bottom: "b" top: "cut" }
)";

TEST_F(NetTest, OfLayersOfOneNameTheFirstHasTheWeightsAlsoWhenItIsCutOff) {
  const auto load = [&](const std::string& param, const std::string& end, bool allow_missing) {
    std::string text = kTwins;
    write_file(prototxt(), text.replace(text.find("PARAM"), 5, param));
    return Net::load(prototxt(), weights(), {.end = end, .allow_missing = allow_missing});
  };
  caffe::NetParameter net;
  net.add_layer()->set_name("twin");
  caffe::BlobProto& blob = *net.mutable_layer(0)->add_blobs();
  for (const int size : {1, 1}) blob.mutable_shape()->add_dim(size);
  blob.add_data(3);
  proto::write_net_binary(weights(), net);
  for (const std::string end : {"", "cut"}) {
    expect_error<InputError>([&] { load("", end, false); }, {"twin (another layer of this name"});
    engine::Run run(load("", end, true).plan());
    EXPECT_EQ(forward(run, {2}, end.empty() ? "cut" : end), std::vector<float>{0});
  }
  // Its parameter is not shared.
  expect_error<InputError>([&] { load("param { name: 'w' }", "cut", false); }, {"twin (another"});
  // Weights in the prototxt apply to the layer that contains them.
  engine::Run run(load("blobs { shape { dim: 1 dim: 1 } data: 5 }", "cut", false).plan());
  EXPECT_EQ(forward(run, {2}, "cut"), std::vector<float>{10});
}

TEST_F(NetTest, WeightsOfThePrototxtAreTakenUnlessTheFileHasOthers) {
  const std::string net = R"(
    layer { name: "data" type: "Input" top: "data" input_param { shape { dim: 1 dim: 2 } } }
    layer { name: "NAME" type: "Scale" bottom: "data" top: "s" blobs { shape { dim: 2 } data: 3 data: 5 } })";
  const auto write = [&](const std::string& name) {
    std::string text = net;
    write_file(prototxt(), text.replace(text.find("NAME"), 4, name));
  };
  write("s");
  engine::Run run(Net::load(prototxt(), weights()).plan());
  EXPECT_EQ(forward(run, {1, 1}, "s"), (std::vector<float>{3, 5}));
  caffe::NetParameter file;
  file.add_layer()->set_name("s");
  file.mutable_layer(0)->add_blobs()->mutable_shape()->add_dim(2);
  for (const float value : {7.0F, 8.0F}) file.mutable_layer(0)->mutable_blobs(0)->add_data(value);
  proto::write_net_binary(weights(), file);
  engine::Run other(Net::load(prototxt(), weights()).plan());
  EXPECT_EQ(forward(other, {1, 1}, "s"), (std::vector<float>{7, 8}));
  std::string text = net;
  write_file(prototxt(), text.replace(text.find("dim: 2 } data"), 6, "dim: 3"));
  expect_error<InputError>([&] { Net::load(prototxt(), weights()); }, {"net.prototxt", "'NAME'"});
}

TEST_F(NetTest, SharedWeightsOfThePrototxtAreThoseOfTheirFirstLayer) {
  const std::string inner =
                        "layer { type: 'InnerProduct' bottom: 'data' param { name: 'w' } "
                        "inner_product_param { num_output: 1 bias_term: false } ",
                    own = "blobs { shape { dim: 1 dim: 2 } data: ";
  const auto write = [&](const std::string& first, const std::string& second) {
    write_file(prototxt(), "input: 'data' input_shape { dim: [1, 2] }" + inner +
                               "name: 'a' top: 'a' " + first + "}" + inner + "name: 'b' top: 'b' " +
                               second + "}");
  };
  for (const std::string& second : {own + "1 data: 2 }", std::string()}) {
    write(own + "10 data: 20 }", second);
    for (const std::string end : {"", "b"}) {
      const LoadOptions options{.end = end};
      for (const Net& net : {Net::load(prototxt(), weights(), options),
                             Net::load_without_weights(prototxt(), options)}) {
        engine::Run run(net.plan());
        EXPECT_EQ(forward(run, {1, 1}, "b"), std::vector<float>{30}) << second << end;
      }
    }
  }
  write("", own + "1 data: 2 }");  // overwritten by the first layer's filler
  for (const std::string end : {"", "b"})
    expect_error<InputError>([&] { Net::load(prototxt(), weights(), {.end = end}); },
                             {"no weights"});
  write("blobs { shape { dim: 3 } data: 1 data: 2 data: 3 }", "");
  expect_error<InputError>([&] { Net::load_without_weights(prototxt(), {.end = "b"}); },
                           {"net.prototxt", "'b'", "layer 'a'", "3 values instead of 2"});
}

TEST_F(NetTest, LayersThatForksDefineOtherwiseAreSaid) {
  const auto warnings = [](const std::string& type, const std::string& param) {
    return test::small_net({1, 4, 2, 2}, test::layer("x", type, {"data"}, param) +
                                             test::layer("y", "Power", {"x"}))
        .warnings();
  };
  for (const auto& [type, param] : {std::pair("Reorg", "reorg_param { stride: 2 }"),
                                    std::pair("Reverse", "reverse_param { }")}) {
    ASSERT_EQ(warnings(type, param).size(), 1U);
    EXPECT_HAS(warnings(type, param)[0], "layer 'x' (" + std::string(type) + ") is computed ");
  }
  EXPECT_TRUE(warnings("Reverse", "reverse_param { axis: 0 }").empty());
}

TEST_F(NetTest, DropoutsOfOneNameDrawByThemselves) {
  const std::string drop =
      "layer { name: 'drop' type: 'Dropout' bottom: 'data' dropout_param { sample_weights_test: "
      "true } top: ";
  const std::vector<float> ones(1000, 1);
  const auto outputs = [&](const std::string& end, const std::string& name) {
    engine::Run run(
        test::small_net({1000},
                        drop + "'a' } " + drop + "'b' } " + test::layer("end", "Power", {"b"}), end)
            .plan());
    return forward(run, ones, name);
  };
  EXPECT_NE(outputs("", "a"), outputs("", "end"));
  EXPECT_EQ(outputs("", "end"), outputs("end", "end"));
}

TEST_F(NetTest, SharedParametersMustHaveOneShape) {
  write_file(prototxt(), R"(
    layer { name: "data" type: "Input" top: "data" input_param { shape { dim: 1 dim: 1 dim: 4 dim: 4 } } }
    layer { name: "one" type: "Convolution" bottom: "data" top: "a" param { name: "w" }
            convolution_param { num_output: 1 kernel_size: 2 bias_term: false } }
    layer { name: "two" type: "Convolution" bottom: "a" top: "b" param { name: "w" }
            convolution_param { num_output: 1 kernel_h: 1 kernel_w: 4 bias_term: false } })");
  expect_error<InputError>(
      [&] {
        Net::load_without_weights(prototxt(), {.inputs = {{"data", Shape{1, 1, 9, 9}}}});
      },
      {"'two'", "'w'", "'one'", "1x1x2x2", "1x1x1x4"});
}

TEST_F(NetTest, WithoutWeightsItCanBePlannedButNotRun) {
  const Net net = Net::load_without_weights(prototxt());
  EXPECT_EQ(net.plan().layers().size(), 6U);
  expect_error<UsageError>([&] { engine::Run(net.plan()); }, {"without weights"});
}

TEST_F(NetTest, WeightsAreGivenAsTheFileHasThem) {
  write_weights("conv", {1, 1, 1, 1}, {2}, {1});
  const Net net = Net::load(prototxt(), weights());
  const auto found = net.weights();
  ASSERT_EQ(found.size(), 1U);
  EXPECT_EQ(found[0].first, "conv");
  ASSERT_EQ(found[0].second.size(), 2U);
  EXPECT_EQ(found[0].second[0].shape, (Shape{1, 1, 1, 1}));
  EXPECT_EQ(found[0].second[0].values()[0], 2);
  EXPECT_EQ(found[0].second[1].shape, Shape{1});
  EXPECT_EQ(found[0].second[1].values()[0], 1);
  const Net copy = net;
  EXPECT_EQ(copy.weights()[0].second[0].data, found[0].second[0].data);
  EXPECT_TRUE(Net::load_with_random_weights(prototxt(), 1, {.end = "data"}).weights().empty());
}

TEST_F(NetTest, WeightsThatAreNotThereAreNotGiven) {
  expect_error<UsageError>([&] { (void)Net::load_without_weights(prototxt()).weights(); },
                           {"net.prototxt", "without weights"});
}

TEST_F(NetTest, RandomWeightsAreTheSameForTheSameSeed) {
  const auto first_output = [&](uint64_t seed) {
    engine::Run run(Net::load_with_random_weights(prototxt(), seed).plan({}, {.keep_all = true}));
    forward(run, {1, 2, 3, 4, 5, 6}, "concat");
    return of_layer(run, "conv");
  };
  EXPECT_EQ(first_output(1), first_output(1));
  EXPECT_NE(first_output(1), first_output(2));
}

TEST_F(NetTest, RandomWeightsAreSharedWhereParametersAre) {
  const std::string conv = "num_output: 2 kernel_size: 3 } param { name: 'w' } param { name: 'b'";
  const Net net =
      test::small_net({1, 1, 5, 5}, test::conv("a", "data", conv) + test::conv("b", "data", conv));
  engine::Run run(net.plan());
  test::fill_randomly(run);
  run.forward();
  EXPECT_TRUE(std::ranges::equal(run.output("a").values(), run.output("b").values()));
}

TEST_F(NetTest, RandomWeightsOfBatchNormHavePositiveVariance) {
  write_file(prototxt(), std::string(kNet) +
                             "layer { name: 'bn' type: 'BatchNorm' bottom: 'concat' top: 'bn' }");
  engine::Run run(Net::load_with_random_weights(prototxt(), 3).plan());
  for (const float value : forward(run, {1, 2, 3, 4, 5, 6}, "bn"))
    EXPECT_TRUE(std::isfinite(value)) << value;
}

TEST_F(NetTest, UnknownLayerTypesMatterOnlyWhenNeeded) {
  write_file(prototxt(), std::string(kNet) +
                             "layer { name: 'odd' type: 'Strange' bottom: 'concat' top: 'odd' }");
  expect_error<UnsupportedError>([&] { Net::load(prototxt(), weights()); }, {"'odd'", "'Strange'"});
  const Net net = Net::load(prototxt(), weights(), {.end = "concat"});
  EXPECT_EQ(net.outputs(), std::vector<std::string>{"concat"});
}

TEST_F(NetTest, IgnoresLayersBeyondTheEnd) {
  for (const char* beyond :
       {"correlation_param { pad: 3 }", "relu_param { odd: 3 }", "relu_param { negative_slope: x }",
        "relu_param { negative_slope: 1 negative_slope: 2 }", "clip_param { }", "bottom: 'nowhere'",
        "top: 'conv'", "include { } exclude { }", "[my.ext]: 3",
        "convolution_param { engine: ODD pad_type: VALID }"}) {
    SCOPED_TRACE(beyond);
    write_file(prototxt(), std::string(kNet) +
                               "layer { name: 'odd' type: 'ReLU' bottom: 'concat' top: 'odd' " +
                               beyond + " }");
    EXPECT_THROW(Net::load(prototxt(), weights()), InputError);
    const Net net = Net::load(prototxt(), weights(), {.end = "concat"});
    EXPECT_EQ(net.outputs(), std::vector<std::string>{"concat"});
    EXPECT_EQ(net.layer_names().back(), "odd");
    EXPECT_TRUE(net.warnings().empty());
    EXPECT_EQ(input_blobs(prototxt()), std::vector<std::string>{"data"});
  }
}

TEST_F(NetTest, SkipsUnknownLayersWithoutOutputs) {
  const std::string net = kNet;
  write_file(prototxt(), net + "layer { name: 'e' type: 'Evil' bottom: 'conv' x_param { } }");
  const std::vector<std::string> warnings = Net::load(prototxt(), weights()).warnings();
  ASSERT_EQ(warnings.size(), 1U);
  EXPECT_HAS(warnings[0], "layer 'e' (Evil): unknown field 'x_param'");
  EXPECT_HAS(warnings[0], "the layer writes no blob and is skipped");
  for (const std::string type : {"", "type: 'ReLU' "}) {  // `top` may be misspelled
    write_file(prototxt(), net + "layer { name: 'r' " + type + "bottom: 'conv' tpo: 'r' }");
    expect_error<InputError>([&] { Net::load(prototxt(), weights()); }, {"'r'", "'tpo'"});
  }
}

TEST_F(NetTest, OldTypesOfForksBeyondTheEndDoNotMatter) {
  write_file(prototxt(),
             "input: 'data' input_dim: [1, 1, 2, 3] layers { name: 'relu' type: RELU bottom: "
             "'data' top: 'relu' } layers { name: 'crf' type: MULTI_STAGE_MEANFIELD bottom: "
             "'relu' top: 'crf' multi_stage_meanfield_param { num_iterations: 10 } }");
  expect_error<UnsupportedError>([&] { Net::load_without_weights(prototxt()); },
                                 {"'crf'", "'MULTI_STAGE_MEANFIELD'", "it is of CRF-as-RNN"});
  const Net net = Net::load_without_weights(prototxt(), {.end = "relu"});
  EXPECT_EQ(net.outputs(), std::vector<std::string>{"relu"});
}

TEST_F(NetTest, IgnoresV0LayersBeyondTheEnd) {
  for (const std::string beyond :
       {"layers { layer { name: 'odd' type: 'my_new' } bottom: 'relu' top: 'odd' }",
        "layers { layer { name: 'odd' type: 'relu' } bottom: 'nobody' top: 'odd' }",
        "layers { name: 'odd' type: RELU bottom: 'relu' top: 'odd' }",
        "layers { layer { name: 'p' type: 'padding' } bottom: 'relu' top: 'p' } "
        "layers { layer { name: 'odd' type: 'relu' } bottom: 'p' top: 'odd' }"}) {
    SCOPED_TRACE(beyond);
    write_file(prototxt(),
               "input: 'data' input_dim: [1, 1, 2, 3] layers { layer { name: "
               "'relu' type: 'relu' } bottom: 'data' top: 'relu' } " +
                   beyond);
    expect_error<InputError>([&] { Net::load_without_weights(prototxt()); }, {"layer 'odd'"});
    const Net net = Net::load_without_weights(prototxt(), {.end = "relu"});
    EXPECT_EQ(net.outputs(), std::vector<std::string>{"relu"});
  }
}

TEST_F(NetTest, LayersOfTrainingAreSaidToBeLeftOut) {
  write_file(prototxt(),
             "layer { name: 'd' type: 'Data' top: 'x' top: 'l' data_param { batch_size: 1 } "
             "transform_param { crop_size: 2 } }"
             "layer { name: 'sl' type: 'Slice' bottom: 'l' top: 'l1' top: 'l2' }"
             "layer { name: 'fc' type: 'InnerProduct' bottom: 'x' top: 'fc' "
             "inner_product_param { num_output: 2 } }"
             "layer { name: 'a' type: 'Accuracy' bottom: 'fc' bottom: 'l2' }"
             "layer { name: 'loss' type: 'SoftmaxWithLoss' bottom: 'fc' bottom: 'l1' }");
  const auto end = [&](const std::string& layer) {
    Net::load_without_weights(prototxt(), {.end = layer});
  };
  expect_error<UsageError>([&] { end("sl"); },
                           {"end: the layer 'sl' is not part of the net: it is for training only"});
  expect_error<UsageError>([&] { end("loss"); },
                           {"'loss' is not part of the net: it is now 'prob'"});
  EXPECT_NO_THROW(end("fc"));
}

TEST_F(NetTest, TypesAreNotSupportedBeforeFieldsAreUnknown) {
  write_file(prototxt(), std::string(kNet) +
                             "layer { name: 'odd' type: 'Correlation' bottom: 'concat' "
                             "top: 'odd' correlation_param { pad: 3 } }");
  expect_error<UnsupportedError>(
      [&] { Net::load(prototxt(), weights()); },
      {"'odd'", "'Correlation'", "it is of FlowNet", "end the net before it", "revisit.caffe"});
}

TEST_F(NetTest, RunsOfOnePlanWorkInParallel) {
  const Plan plan = Net::load(prototxt(), weights()).plan({{"data", Shape{1, 1, 50, 60}}});
  std::vector<std::thread> threads;
  for (int t = 0; t < 4; ++t)
    threads.emplace_back([&plan, t] {
      engine::Run run(plan);
      std::vector<float> input(3000), wanted(6000);  // relu(2 x + 1), twice
      for (int i = 0; i < 3000; ++i) {
        input[i] = static_cast<float>((i * 7 + t) % 100 - 50);
        wanted[i] = wanted[i + 3000] = std::max(2 * input[i] + 1, 0.0F);
      }
      for (int i = 0; i < 20; ++i) EXPECT_EQ(forward(run, input, "concat"), wanted);
    });
  for (std::thread& thread : threads) thread.join();
}

TEST(Threads, ManyGiveTheSameBits) {
  const Net net = test::small_net(
      {2, 16, 33, 35},
      test::conv("c", "data") + test::layer("n", "LRN", {"c"}) +
          test::layer("p", "Pooling", {"n"}, "pooling_param { kernel_size: 3 stride: 2 }") +
          test::layer("ip", "InnerProduct", {"p"}, "inner_product_param { num_output: 70 }"));
  const auto result = [&](int threads) {
    return test::forward(net, {.threads = threads}).at("ip").values;
  };
  const std::vector<float> wanted = result(1);
  for (const int threads : {8, 16, 61}) EXPECT_EQ(result(threads), wanted) << threads;
}

TEST_F(NetTest, MissingWeightsComeFromTheirFillers) {
  const auto values = [&](const std::string& layers, uint64_t seed = 0) {
    write_file(prototxt(),
               "layer { name: 'data' type: 'Input' top: 'data' input_param { shape { "
               "dim: [1, 2, 3, 3] } } }" +
                   layers);
    const Net net = Net::load(prototxt(), weights(), {.allow_missing = true, .fill_seed = seed});
    std::vector<std::vector<float>> all;
    for (const auto& [name, blobs] : net.weights())
      for (const auto& blob : blobs) all.emplace_back(blob.values().begin(), blob.values().end());
    return all;
  };
  const auto layer = [](const std::string& type, const std::string& param) {
    return "layer { name: 'l' type: '" + type + "' bottom: 'data' top: 'l' " + param + " }";
  };
  using Blobs = std::vector<std::vector<float>>;
  EXPECT_EQ(values(layer("Scale", "scale_param { bias_term: true bias_filler { value: -3 } }")),
            (Blobs{{1, 1}, {-3, -3}}));
  EXPECT_EQ(values(layer("PReLU", "")), (Blobs{{0.25F, 0.25F}}));
  EXPECT_EQ(values(layer("BatchNorm", "batch_norm_param { bias_filler { value: 2 } }")),
            (Blobs{{0, 0}, {0, 0}, {1}, {1, 1}, {2, 2}}));
  EXPECT_EQ(values(layer("BN", "bn_param { frozen: true slope_filler { value: 3 } }")),
            (Blobs{{3, 3}, {0, 0}, {0, 0}, {1, 1}}));
  EXPECT_EQ(values(layer("Deconvolution",
                         "convolution_param { num_output: 2 group: 2 kernel_size: "
                         "4 bias_term: false weight_filler { type: 'bilinear' } }"))[0][5],
            0.5625F);
  const std::string fc = "inner_product_param { num_output: 4 bias_term: false weight_filler { ";
  for (const auto& [filler, most] : {std::pair{"type: 'xavier'", 0.41F},
                                     {"type: 'msra'", 3.0F},
                                     {"type: 'gaussian' std: 0.1", 0.7F},
                                     {"type: 'uniform' min: -2 max: -1", 2.0F},
                                     {"type: 'positive_unitball'", 1.0F}}) {
    const auto found = values(layer("InnerProduct", str(fc, filler, " } }")), 7)[0];
    const auto [low, high] = std::minmax_element(found.begin(), found.end());
    EXPECT_TRUE(*low >= -most && *high <= most && *low < *high) << filler;
    EXPECT_EQ(values(layer("InnerProduct", str(fc, filler, " } }")), 7)[0], found);
    EXPECT_NE(values(layer("InnerProduct", str(fc, filler, " } }")), 8)[0], found);
  }
  expect_error<InputError>([&] { values(layer("InnerProduct", fc + "type: 'odd' } }")); },
                           {"layer 'l' (InnerProduct): filler: expected one of", "'odd'"});
}

TEST_F(NetTest, LayersThatWriteNoBlobDoNotTakeOutputsAway) {
  const std::string input =
      "layer { name: 'data' type: 'Input' top: 'data' input_param { shape { dim: [1, 2] } } } ";
  const std::string relu = "layer { name: 'r' type: 'ReLU' bottom: 'data' top: 'r' } ";
  const std::string print = "layer { name: 'debug' type: 'Python' bottom: 'r' } ";
  write_file(prototxt(), input + relu + print);
  EXPECT_EQ(Net::load_without_weights(prototxt()).outputs(), std::vector<std::string>{"r"});
  write_file(prototxt(), "layer { name: 'debug' type: 'Python' python_param { layer: 'L' } }");
  expect_error<InputError>([&] { Net::load_without_weights(prototxt()); },
                           {"none of its layers writes a blob"});
  write_file(prototxt(), input + relu + "layer { name: 'p' type: 'Softmax' bottom: 'r' }");
  expect_error<InputError>([&] { Net::load_without_weights(prototxt()); },
                           {"layer 'p' (Softmax) has no top"});
  EXPECT_EQ(Net::load_without_weights(prototxt(), {.end = "r"}).outputs().size(), 1U);
}

TEST_F(NetTest, WarnsOfABatchNormWithoutCorrectionAndOfNetsThatEndInSilence) {
  write_file(prototxt(),
             "layer { name: 'data' type: 'Input' top: 'data' input_param { shape { dim: "
             "[1, 1, 1, 2] } } } layer { name: 'conv' type: 'BatchNorm' bottom: 'data' "
             "top: 'bn' blobs { shape { dim: 1 } data: 5 } blobs { shape { dim: 1 } "
             "data: 1 } blobs { shape { dim: 1 } data: 0 } } layer { type: 'Silence' "
             "bottom: 'bn' }");
  const auto warnings = Net::load_without_weights(prototxt()).warnings();
  ASSERT_EQ(warnings.size(), 2U);
  EXPECT_HAS(warnings[0], "no output, because Silence layers read 'bn'; end names");
  EXPECT_HAS(warnings[1], "'conv' (BatchNorm): its correction (blob 2) is 0");
  EXPECT_EQ(Net::load_without_weights(prototxt(), {.end = "bn"}).outputs(),
            std::vector<std::string>{"bn"});
}

}  // namespace
}  // namespace revisit::engine
