#include "revisit/proto/net_file.h"
#include "testing.h"

namespace revisit::proto {
namespace {

constexpr const char* kStrangeNet = R"(
  name: "small"
  layer { name: "in" type: "Input" top: "data" input_param { shape { dim: 1 dim: 1 dim: 8 dim: 8 } } }
  layer { name: "conv1" type: "Convolution" bottom: "data" top: "conv1" convolution_param { num_output: 2 kernel_size: 3 } }
  layer { name: "relu1" type: "ReLU" bottom: "conv1" top: "conv1" }
  layer { name: "conv2" type: "Convolution" bottom: "conv1" top: "conv2" convolution_param { num_output: 2 kernel_size: 3 } }
  layer { name: "pool" type: "Pooling" bottom: "conv2" top: "pool" pooling_param { kernel_size: 2 stride: 2 } }
  layer { name: "strange" type: "FromAnotherFork" bottom: "pool" top: "strange" }
)";

Graph parse_text(const std::string& text) {
  return resolve(parse_net(text, "test.prototxt").net);
}

std::vector<std::string> names(const Graph& graph) {
  std::vector<std::string> result;
  for (const Node& node : graph.nodes) result.push_back(node.name);
  return result;
}

TEST(Graph, InPlaceLayersMakeValuesOfTheirOwn) {
  const Graph graph = parse_text(kStrangeNet);
  EXPECT_EQ(graph.values.size(), 6U);
  EXPECT_TRUE(graph.nodes[2].in_place);
  EXPECT_FALSE(graph.nodes[1].in_place);
  EXPECT_NE(graph.nodes[1].outputs[0], graph.nodes[2].outputs[0]);
  EXPECT_EQ(graph.nodes[3].inputs[0], graph.nodes[2].outputs[0]);
  ASSERT_EQ(graph.outputs.size(), 1U);
  EXPECT_EQ(graph.outputs[0].first, "strange");
}

TEST(Graph, TruncationKeepsNeededLayers) {
  const Graph graph = parse_text(kStrangeNet);
  EXPECT_EQ(names(prune(graph, "conv1", "")), (std::vector<std::string>{"in", "conv1"}));
  EXPECT_EQ(names(prune(graph, "relu1", "")), (std::vector<std::string>{"in", "conv1", "relu1"}));
}

TEST(Graph, GraftFollowsTheInPlaceReluOfItsLayer) {
  const Graph graph = prune(parse_text(kStrangeNet), "conv1", "pool");
  EXPECT_EQ(names(graph), (std::vector<std::string>{"in", "conv1", "relu1", "conv1+pool"}));
  EXPECT_EQ(graph.outputs[0].first, "conv1+pool");
  EXPECT_EQ(graph.nodes[3].inputs[0], graph.nodes[2].outputs[0]);
  EXPECT_EQ(graph.nodes[3].index, 4);  // of the layer of the file
}

TEST(Graph, GraftWithoutReluGoesOnTheLayerItself) {
  EXPECT_EQ(names(prune(parse_text(kStrangeNet), "conv2", "pool")),
            (std::vector<std::string>{"in", "conv1", "relu1", "conv2", "conv2+pool"}));
}

/// First layers of kStrangeNet, as written by exporters without in-place layers.
std::string with_own_blobs(const std::string& further) {
  return R"(
  layer { name: "in" type: "Input" top: "data" input_param { shape { dim: 1 dim: 1 dim: 8 dim: 8 } } }
  layer { name: "conv1" type: "Convolution" bottom: "data" top: "conv1" convolution_param { num_output: 2 kernel_size: 3 } }
  layer { name: "relu1" type: "ReLU" bottom: "conv1" top: "relu1" }
  layer { name: "pool" type: "Pooling" bottom: "relu1" top: "pool" pooling_param { kernel_size: 2 } })" +
         further;
}

TEST(Graph, GraftFollowsAReluWithABlobOfItsOwn) {
  const Graph graph = prune(parse_text(with_own_blobs("")), "conv1", "pool");
  EXPECT_EQ(names(graph), (std::vector<std::string>{"in", "conv1", "relu1", "conv1+pool"}));
  EXPECT_EQ(graph.nodes[3].inputs[0], graph.nodes[2].outputs[0]);
  EXPECT_TRUE(graph.warnings.empty());
}

TEST(Graph, WarnsOfAGraftBeforeAReluInPlace) {
  const Graph whole = parse_text(with_own_blobs(
      R"(layer { name: "sum" type: "Eltwise" bottom: "conv1" bottom: "relu1" top: "sum" })"));
  const Graph graph = prune(whole, "conv1", "pool");
  EXPECT_EQ(names(graph), (std::vector<std::string>{"in", "conv1", "conv1+pool"}));
  ASSERT_EQ(graph.warnings.size(), 1U);
  EXPECT_EQ(graph.warnings[0],
            "'conv1+pool' is grafted onto 'conv1' before the ReLU 'relu1', because other layers "
            "read it, too; end the net at 'relu1' to graft after it");
  EXPECT_EQ(names(prune(whole, "relu1", "pool")),
            (std::vector<std::string>{"in", "conv1", "relu1", "relu1+pool"}));
}

TEST(Graph, GraftFollowsTheBlockOfItsLayer) {
  // in: works in place; own: with a blob of its own
  struct Case {
    std::vector<std::string> layers, kept;
  };
  for (const auto& [layers, kept] :
       {Case{{"BatchNorm in", "Scale in", "ReLU in"}, {"BatchNorm", "Scale", "ReLU"}},
        Case{{"BatchNorm own", "Scale in", "ReLU own"}, {"BatchNorm", "Scale", "ReLU"}},
        Case{{"ReLU in", "PReLU in"}, {"ReLU", "PReLU"}},
        Case{{"ReLU in", "BatchNorm own"}, {"ReLU"}},
        Case{{"ReLU own", "ReLU in", "Pooling own"}, {"ReLU", "ReLU"}}, Case{{"PReLU own"}, {}}}) {
    std::string text =
                    "layer { name: 'in' type: 'Input' top: 'data' } "
                    "layer { name: 'conv' type: 'Convolution' bottom: 'data' top: 'conv' } ",
                blob = "conv";
    for (const std::string& layer : layers) {
      const std::string type = layer.substr(0, layer.find(' '));
      const std::string top = layer.ends_with("in") ? blob : blob + "2";
      text += "layer { name: '" + type + "' type: '" + type + "' bottom: '" + blob + "' top: '" +
              top + "' } ";
      blob = top;
    }
    text += "layer { name: 'pool' type: 'Pooling' bottom: '" + blob + "' top: 'pool' } ";
    std::vector<std::string> wanted{"in", "conv"};
    wanted.insert(wanted.end(), kept.begin(), kept.end());
    wanted.emplace_back("conv+pool");
    EXPECT_EQ(names(prune(parse_text(text), "conv", "pool")), wanted) << text;
  }
}

TEST(Graph, GraftAfterManyLayersInPlaceTakesTimeByTheirNumber) {
  const auto seconds = [](int layers) {
    std::string text = with_own_blobs("");
    for (int i = 0; i < layers; ++i)
      text += str("layer { name: '", i, "' type: 'PReLU' bottom: 'conv1' top: 'conv1' } ");
    const Graph whole = parse_text(text);
    double least = std::numeric_limits<double>::infinity();
    for (int i = 0; i < 3; ++i) {
      const auto start = std::chrono::steady_clock::now();
      prune(whole, "conv1", "pool");
      const std::chrono::duration<double> taken = std::chrono::steady_clock::now() - start;
      least = std::min(least, taken.count());
    }
    return least;
  };
  EXPECT_LT(seconds(16'000), 60 * seconds(1000));  // quadratic cost would be 256 times
}

TEST(Graph, NothingIsGraftedOntoALayerWithSeveralOutputs) {
  const Graph graph = parse_text(
      with_own_blobs(R"(layer { name: "cut" type: "Slice" bottom: "pool" top: "a" top: "b" })"));
  expect_error<UsageError>([&] { prune(graph, "cut", "pool"); }, {"graft: ", "'cut'", "2 outputs"});
}

TEST(Graph, UnknownLayersAreNamedWithTheNearest) {
  const Graph graph = parse_text(kStrangeNet);
  expect_error<UsageError>([&] { prune(graph, "conv3", ""); },
                           {"end: ", "conv3", "did you mean 'conv"});
  expect_error<UsageError>([&] { prune(graph, "conv1", "pol"); },
                           {"graft: ", "did you mean 'pool'"});
  expect_error<UsageError>([&] { prune(graph, "", "pool"); }, {"graft needs end"});
}

TEST(Graph, RefusesDanglingAndDoublyWrittenBlobs) {
  expect_error<InputError>(
      [] {
        prune(parse_text(R"(layer { name: "a" type: "ReLU" bottom: "dato" top: "b" })"), "", "");
      },
      {"'a'", "'dato'"});
  expect_error<InputError>(
      [] {
        prune(
            parse_text(
                R"(layer { name: "a" type: "Input" top: "x" } layer { name: "b" type: "Input" top: "x" })"),
            "", "");
      },
      {"'b'", "already written"});
}

TEST(Graph, TheEndMayBeABlob) {
  const std::string net =
      "layer { name: 'in' type: 'Input' top: 'data' }"
      "layer { name: 'first' type: 'ReLU' bottom: 'data' top: 'x' }"
      "layer { name: 'crop' type: 'ReLU' bottom: 'x' top: 'x' }"
      "layer { name: 'crop' type: 'Slice' bottom: 'x' top: 'a' top: 'b' }";
  const Graph graph = prune(parse_text(net), "x", "");
  EXPECT_EQ(names(graph), (std::vector<std::string>{"in", "first", "crop"}));  // its last value
  EXPECT_EQ(graph.outputs[0].first, "x");
  EXPECT_EQ(names(prune(parse_text(net), "data", "first")).back(), "data+first");
  expect_error<UsageError>([&] { prune(parse_text(net), "crop", ""); },
                           {"2 layers have the name 'crop'", "'crop' (ReLU), which writes 'x'",
                            "'crop' (Slice), which writes 'a', 'b'", "the name of a blob"});
  expect_error<UsageError>([&] { prune(parse_text(net), "dara", ""); },
                           {"no layer or blob 'dara'", "'data'"});
}

}  // namespace
}  // namespace revisit::proto
