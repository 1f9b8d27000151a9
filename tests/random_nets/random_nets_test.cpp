// A fixed range of seeds; revisit_random_nets (main.cpp) goes on for hours.
#include <gtest/gtest.h>

#include <set>

#include "check.h"
#include "reference.h"
#include "revisit/engine/layer_types.h"
#include "revisit/proto/error.h"
#include "test_data.h"

namespace revisit::random_nets {
namespace {

#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)
constexpr uint64_t kNetsOfATest = 8;
#else
constexpr uint64_t kNetsOfATest = 60;
#endif
constexpr uint64_t kTests = 8, kGenerated = 480;
constexpr uint64_t kFirst = 100;

TEST(RandomNets, CoverEveryLayerType) {
  std::set<std::string> missing;
  for (const engine::LayerType& type : engine::layer_types()) missing.insert(type.type);
  for (uint64_t seed = 0; seed < kGenerated && !missing.empty(); ++seed) {
    const RandomNet net = make_random_net(seed);
    for (const caffe::LayerParameter& layer : net.net.layer()) missing.erase(layer.type());
  }
  for (const std::string& type : missing)
    ADD_FAILURE() << type << " is in no random net; add it to layer_makers.cpp";
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
  if (kNetsOfATest >= 60) {  // a share of a few nets is chance
    EXPECT_LE(statistics.too_large, statistics.nets / 10) << "nets that compare no numbers";
  }
}

INSTANTIATE_TEST_SUITE_P(Seeds, RandomNetsAgree,
                         testing::Range<uint64_t>(kFirst, kFirst + kTests * kNetsOfATest,
                                                  kNetsOfATest));

TEST(RandomNets, WhatRoundingExplainsIsNoFault) {
  Statistics statistics;
  // bfloat16 rounds x = -0.263538 to -0.263672; 1 / (1.75391 x + 0.462402) is 5547, then -18266.
  EXPECT_EQ(find_fault(80012930, statistics), "");
  // 0.8546 - 0.8986, each a sum of 2352 terms, and a convolution of one number cancel out.
  EXPECT_EQ(find_fault(80040123, statistics), "");
  EXPECT_EQ(find_fault(80040767, statistics), "");
}

/// That a comparison with a reference can fail.
TEST(RandomNetsReference, SeesWhatRoundingDoesNotExplain) {
  const test::TempDir folder;
  test::write_file(folder / "net.prototxt",
                   "layer { name: 'x' type: 'Input' top: 'x' input_param { shape { dim: 1 dim: 2 "
                   "dim: 4 dim: 4 } } }"
                   "layer { name: 'p' type: 'Power' bottom: 'x' top: 'p' power_param { scale: 3 } }"
                   "layer { name: 'm' type: 'Pooling' bottom: 'x' top: 'm' pooling_param { "
                   "kernel_size: 2 stride: 2 } }");
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

}  // namespace
}  // namespace revisit::random_nets
