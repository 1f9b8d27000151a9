#include "net_case.h"
#include "testing.h"

namespace revisit::engine {
namespace {

Net example() {
  return small_net(
      {2, 3, 23, 31},
      conv("c1", "data") + in_place("r1", "ReLU", "c1") +
          layer("n1", "LRN", {"c1"}, "lrn_param { local_size: 5 alpha: 1 }") +
          layer("p1", "Pooling", {"n1"}, "pooling_param { pool: AVE kernel_size: 3 stride: 2 }") +
          conv("c2", "p1") + layer("b2", "BatchNorm", {"c2"}) +
          in_place("s2", "Scale", "b2", "scale_param { bias_term: true }") +
          layer("flat", "Flatten", {"p1"}) + in_place("r2", "PReLU", "flat") +
          layer("sum", "Eltwise", {"p1", "b2"}) + layer("join", "Concat", {"sum", "c2"}) +
          layer("p2", "Pooling", {"join"}, "pooling_param { kernel_size: 2 stride: 2 }") +
          layer("f", "InnerProduct", {"p2"}, "inner_product_param { num_output: 7 }") +
          layer("prob", "Softmax", {"f"}));
}

using Blobs = std::map<std::string, std::vector<float>>;

/// Runs a net on the blobs that it reads and stores those that it computes.
void pass(const Net& net, const PlanOptions& options, Blobs* blobs) {
  engine::Run run(net.plan({}, options));
  for (const Port& input : run.plan().inputs())
    std::ranges::copy(blobs->at(input.name), run.input(input.name).data);
  run.forward();
  for (const Port& output : run.plan().outputs()) {
    const auto values = run.output(output.name).values();
    (*blobs)[output.name].assign(values.begin(), values.end());
  }
}

TEST(Part, PassesOverPartsGiveTheBitsOfOnePass) {
  const Net net = example();
  const std::vector<std::string>& layers = net.layer_names();
  Blobs inputs;
  {
    engine::Run run(net.plan());
    test::fill_randomly(run);
    const auto values = run.input("data").values();
    inputs["data"].assign(values.begin(), values.end());
  }
  const PlanOptions options{.keep_all = true};
  Blobs whole = inputs;
  pass(net.part(layers[1], layers.back()), options, &whole);
  EXPECT_EQ(whole.size(), 12U);
  for (size_t cut = 1; cut + 1 < layers.size(); ++cut) {
    Blobs parts = inputs;
    pass(net.part(layers[0], layers[cut]), options, &parts);
    pass(net.part(layers[cut + 1], layers.back()), options, &parts);
    for (const auto& [name, values] : whole)
      EXPECT_EQ(parts.at(name), values) << name << ", cut after " << layers[cut];
  }
}

TEST(Part, PortsAreBlobs) {
  const Net part = example().part("s2", "sum");  // reads p1 after r2, which works on its memory
  std::vector<std::string> inputs;
  for (const Port& input : part.inputs()) inputs.push_back(input.name);
  EXPECT_EQ(inputs, (std::vector<std::string>{"b2", "p1"}));
  EXPECT_EQ(part.inputs()[1].shape, Shape({2, 32, 11, 15}));
  EXPECT_EQ(part.outputs(), (std::vector<std::string>{"b2", "flat", "p1", "sum"}));
  EXPECT_EQ(example().part("s2", "s2").plan({{"b2", {1, 32, 4, 5}}}).outputs()[0].shape,
            Shape({1, 32, 4, 5}));
}

TEST(Part, SharesTheWeights) {
  const Net net = example();
  const Net part = net.part("c2", "c2");
  ASSERT_EQ(part.weights().size(), 1U);
  EXPECT_EQ(part.weights()[0].second[0].data, net.weights()[1].second[0].data);
}

TEST(Part, TruncatedNetHasTheNamedOutputs) {
  const Net net = example(), part = net.truncated({"n1", "b2"});
  EXPECT_EQ(part.outputs(), (std::vector<std::string>{"b2", "n1"}));
  EXPECT_EQ(part.weights()[0].second[0].data, net.weights()[0].second[0].data);
  engine::Run run(part.plan()), whole(net.plan({}, {.keep = {"n1", "b2"}}));
  test::fill_randomly(run);
  std::ranges::copy(run.input("data").values(), whole.input("data").data);
  run.forward();
  whole.forward();
  for (const char* name : {"n1", "b2"}) {
    const auto values = run.output(name).values(), expected = whole.layer_output(name).values();
    ASSERT_EQ(values.size(), expected.size());
    for (size_t i = 0; i < values.size(); ++i) ASSERT_NEAR(values[i], expected[i], 1e-4) << name;
  }
  EXPECT_LT(run.plan().layers().size(), whole.plan().layers().size());
  expect_error<UsageError>([&] { net.truncated({"probe"}); },
                           {"no layer 'probe'", "did you mean 'prob'"});
  expect_error<UsageError>([&] { net.truncated({}); }, {"at least one layer"});
}

TEST(Part, RejectsUnknownLayersAndTheirOrder) {
  const Net net = example();
  expect_error<UsageError>([&] { net.part("c3", "prob"); }, {"part", "has no layer 'c3'", "'c3'"});
  expect_error<UsageError>([&] { net.part("c1", "probe"); },
                           {"has no layer 'probe'", "did you mean 'prob'"});
  expect_error<UsageError>([&] { net.part("p2", "p1"); }, {"'p2' comes after the layer 'p1'"});
}

}  // namespace
}  // namespace revisit::engine
