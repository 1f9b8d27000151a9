// A fixed range of seeds; revisit_random_nets (main.cpp) runs for hours.
#include "check.h"
#include "reference.h"
#include "revisit/engine/net.h"
#include "testing.h"

namespace revisit::random_nets {
namespace {

#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)
constexpr uint64_t kNetsOfATest = 8;
#else
constexpr uint64_t kNetsOfATest = 40;
#endif
constexpr uint64_t kTests = 8, kGenerated = 480;
constexpr uint64_t kFirst = 100;

/// Nets whose layers are counted.
const std::vector<RandomNet>& generated() {
  static const std::vector<RandomNet> nets = [] {
    std::vector<RandomNet> all;
    for (uint64_t seed = 0; seed < kGenerated; ++seed) all.push_back(make_random_net(seed));
    return all;
  }();
  return nets;
}

TEST(RandomNets, CoverEveryLayerType) {
  std::set<std::string> missing;
  for (const engine::LayerType& type : engine::layer_types()) missing.insert(type.type);
  for (const RandomNet& net : generated())
    for (const caffe::LayerParameter& layer : net.net.layer()) missing.erase(layer.type());
  for (const std::string& type : missing)
    ADD_FAILURE() << type << " is in no random net; add it to layer_makers.cpp";
}

TEST(RandomNets, HaveWeightsInTheTypesThatTheRegistrySays) {
  std::set<std::string> with_weights;
  for (const RandomNet& net : generated())
    for (const caffe::LayerParameter& layer : net.net.layer())
      if (layer.blobs_size() > 0) with_weights.insert(layer.type());
  EXPECT_EQ(with_weights, engine::types_with_weights());
}

/// docs/reference/ACCURACY.md lists them.
TEST(RandomNets, HaveReferenceKernelsInTheseTypes) {
  std::set<std::string> found;
  const TempDir folder;
  for (const RandomNet& net : generated()) {
    write(net, folder.path());
    const auto plan = engine::Net::load_without_weights(folder / "net.prototxt")
                          .plan(input_shapes(net, net.sizes[0]).shapes,
                                {.keep_all = true, .reference_kernels = true});
    for (const engine::LayerCost& layer : plan.layers())
      if (layer.kernel == "reference") found.insert(layer.type);
  }
  EXPECT_EQ(found,
            (std::set<std::string>{"BNLL", "Convolution", "ConvolutionDepthwise", "Deconvolution",
                                   "DepthwiseConvolution", "ELU", "InnerProduct", "LRN", "LSTM",
                                   "Lstm", "Mish", "RNN", "ReLU", "ReLU6", "Sigmoid", "Softmax",
                                   "SoftmaxWithLoss", "Swish", "TanH"}));
}

TEST(RandomNets, AreTheSameForTheSameSeed) {
  for (const uint64_t seed : {1, 2, 3}) {
    const RandomNet a = make_random_net(seed), b = make_random_net(seed);
    EXPECT_EQ(a.net.SerializeAsString(), b.net.SerializeAsString());
    EXPECT_EQ(a.sizes, b.sizes);
  }
}

class RandomNetsAgree : public testing::TestWithParam<uint64_t> {};

TEST_P(RandomNetsAgree, InAllWays) {
  Statistics statistics;
  for (uint64_t seed = GetParam(); seed < GetParam() + kNetsOfATest; ++seed) {
    const std::string fault = find_fault(seed, statistics);
    if (!fault.empty()) ADD_FAILURE() << fault;
  }
  RecordProperty("insensitive", std::to_string(statistics.insensitive));
  EXPECT_LE(statistics.insensitive, statistics.outputs / 10) << "tolerances that find nothing";
  if (kNetsOfATest >= 40) {  // fractions of a few nets are random
    EXPECT_LE(statistics.too_large, statistics.nets / 10) << "nets that compare no numbers";
  }
}

INSTANTIATE_TEST_SUITE_P(Seeds, RandomNetsAgree,
                         testing::Range<uint64_t>(kFirst, kFirst + kTests * kNetsOfATest,
                                                  kNetsOfATest));

TEST(RandomNetsReference, FindsErrorsLargerThanRounding) {
  const TempDir folder;
  write_file(folder / "net.prototxt",
             "input: 'x' input_shape { dim: [1, 2, 4, 4] }layer { name: 'p' type: 'Power' bottom: "
             "'x' top: 'p' power_param { scale: 3 } }layer { name: 'm' type: 'Pooling' bottom: 'x' "
             "top: 'm' pooling_param { kernel_size: 2 stride: 2 } }");
  const engine::Net net = engine::Net::load_without_weights(folder / "net.prototxt");
  Values inputs{{"x", {{1, 2, 4, 4}, {}}}};
  for (int i = 0; i < 32; ++i) inputs.at("x").values.push_back(static_cast<float>(i % 7) - 3);
  Reference reference(net, inputs, {{{"p", 1e-5}}});
  int64_t insensitive = 0;
  for (const std::string name : {"p", "m"}) {
    const engine::Tensor right = reference.values().at(name);
    EXPECT_EQ(reference.compare(name, right, insensitive), "");
    engine::Tensor last_digit = right, swapped = right;
    last_digit.values[5] = std::nextafter(last_digit.values[5], 10.0F);
    std::swap(swapped.values[2], swapped.values[3]);
    EXPECT_EQ(reference.compare(name, last_digit, insensitive).empty(), name == "p");
    EXPECT_NE(reference.compare(name, swapped, insensitive), "");
  }
  EXPECT_EQ(insensitive, 0);
}

bool finds_wrong(float number, const std::string& layers, const std::vector<float>& x,
                 caffe::NetParameter weights, Noise noise) {
  weights.add_layer()->set_name("another");  // an empty caffemodel is rejected
  const engine::Net net = engine::Net::load_from_memory(
      str("input: 'x' input_shape { dim: 1 dim: ", x.size(), " } ", layers),
      weights.SerializeAsString());
  const Values inputs{{"x", {{1, std::ssize(x)}, x}}};
  Reference reference(net, inputs, std::move(noise));
  int64_t insensitive = 0;
  return !reference.compare("o", {{1, 1}, {number}}, insensitive).empty();
}

TEST(RandomNetsReference, AtAPoleRoundingExplainsAnySignButNotAnyNumber) {
  // y = -0.263538 has an error of up to 0.0026, so 1 / (1.75391 y + 0.462402) = 5547 is arbitrary.
  const auto is_wrong = [](float number) {
    return finds_wrong(number,
                       "layer { name: 'y' type: 'Power' bottom: 'x' top: 'y' } "
                       "layer { name: 'o' type: 'Power' bottom: 'y' top: 'o' power_param { "
                       "power: -1 scale: 1.75391 shift: 0.462402 } }",
                       {-0.263538F}, {}, {{{"y", 1e-2}}});
  };
  EXPECT_FALSE(is_wrong(5547));
  EXPECT_FALSE(is_wrong(-60'000));
  EXPECT_TRUE(is_wrong(-1e9F));
  EXPECT_TRUE(is_wrong(std::numeric_limits<float>::quiet_NaN()));
}

TEST(RandomNetsReference, CancellationIsRoundedByItsTerms) {
  caffe::NetParameter weights;
  caffe::LayerParameter& layer = *weights.add_layer();
  layer.set_name("o");
  caffe::BlobProto& blob = *layer.add_blobs();
  for (const int64_t dim : {1, 2}) blob.mutable_shape()->add_dim(dim);
  for (const float weight : {1.F, -1.F}) blob.add_data(weight);
  const auto is_wrong = [&](float off, std::map<std::string, double> of_weights) {
    return finds_wrong(0.8546F - 0.8986F + off,
                       "layer { name: 'o' type: 'InnerProduct' bottom: 'x' top: 'o' "
                       "inner_product_param { num_output: 1 bias_term: false } }",
                       {0.8546F, 0.8986F}, weights,
                       {.of_layers = {{"o", 1e-5}}, .of_weights = std::move(of_weights)});
  };
  EXPECT_TRUE(is_wrong(2e-6F, {}));
  EXPECT_FALSE(is_wrong(2e-6F, {{"o", std::sqrt(2)}}));
  EXPECT_TRUE(is_wrong(1e-4F, {{"o", std::sqrt(2)}}));
}

}  // namespace
}  // namespace revisit::random_nets
