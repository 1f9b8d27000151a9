// Concat without copies: its inputs are made where they belong in its output.
#include <gtest/gtest.h>

#include "net_case.h"

namespace revisit::engine {
namespace {

using test::conv;
using test::expect_as_reference;
using test::in_place;
using test::kernel_of;
using test::layer;
using test::small_net;

const Shape kData{1, 16, 12, 16};

/// The kernel of the layer "all" in a net that gives what the reference gives.
std::string concat_kernel(const Shape& data, const std::string& layers) {
  return kernel_of(expect_as_reference(small_net(data, layers)), "all");
}

TEST(Concat, InputsAreMadeInPlace) {
  const std::string layers = conv("a", "data") + in_place("ra", "ReLU", "a") +
                             conv("b", "data", "num_output: 19 kernel_size: 1") +
                             layer("all", "Concat", {"a", "b"}) + conv("next", "all");
  EXPECT_EQ(concat_kernel(kData, layers), "in place");
  EXPECT_EQ(concat_kernel({2, 16, 12, 16}, layers), "copy") << "images of a batch alternate";
  const Plan plan = small_net(kData, layers).plan();
  for (const LayerCost& layer : plan.layers())
    if (layer.name == "all") {
      EXPECT_EQ(layer.activation_bytes, 0);
    }
}

TEST(Concat, PlainValuesToo) {
  EXPECT_EQ(
      concat_kernel(kData, layer("a", "TanH", {"data"}) + layer("b", "Exp", {"data"}) +
                               layer("all", "Concat", {"a", "b"}) + in_place("r", "ReLU", "all")),
      "in place");
  EXPECT_EQ(concat_kernel({1, 3, 5, 7}, layer("a", "TanH", {"data"}) + layer("b", "Exp", {"data"}) +
                                            layer("all", "Concat", {"a", "b"})),
            "copy")
      << "b would not start on a cache line";
}

TEST(Concat, NestedOnes) {
  EXPECT_EQ(concat_kernel(kData, conv("a", "data") + conv("b", "a") +
                                     layer("inner", "Concat", {"a", "b"}) + conv("c", "inner") +
                                     layer("all", "Concat", {"inner", "c"}) + conv("d", "all")),
            "in place");
}

TEST(Concat, CopiesWhatCannotBeTwice) {
  const std::string two = conv("a", "data") + conv("b", "data");
  EXPECT_EQ(concat_kernel(kData, two + layer("all", "Concat", {"a", "a", "b"})), "copy");
  EXPECT_EQ(concat_kernel(kData, two + layer("other", "Concat", {"b", "a"}) +
                                     layer("all", "Concat", {"a", "b"}) +
                                     layer("sum", "Eltwise", {"all", "other"})),
            "copy");
  EXPECT_EQ(
      concat_kernel(kData, layer("a", "TanH", {"data"}) + layer("all", "Concat", {"data", "a"})),
      "copy")
      << "inputs of the net keep their place";
}

TEST(Concat, ChannelsThatDoNotFillABlockAreCopiedPlain) {
  EXPECT_EQ(
      concat_kernel(kData, conv("a", "data", "num_output: 19 kernel_size: 1") + conv("b", "data") +
                               layer("all", "Concat", {"a", "b"}) + conv("next", "all")),
      "in place")
      << "one after another in plain layout";
}

TEST(Concat, PartsCanBeReadBeforeAndAfter) {
  // ra works in place on a, which is a part; p and q read parts late; the ReLU works in place on
  // the whole when nothing reads the parts any more.
  for (const bool late : {false, true}) {
    std::string layers = conv("a", "data") +
                         layer("p", "Pooling", {"a"},
                               "pooling_param { "
                               "kernel_size: 1 }") +
                         conv("b", "data") + layer("all", "Concat", {"a", "b"}) +
                         in_place("r", "ReLU", "all") + conv("next", "all");
    if (late)
      layers += layer("q", "Eltwise", {"a", "b"}, "eltwise_param { operation: PROD }") +
                layer("s", "Scale", {"b"});
    const Net net = small_net(kData, layers);
    EXPECT_EQ(kernel_of(expect_as_reference(net), "all"), "in place");
    expect_as_reference(net, {.keep_all = true});
  }
}

}  // namespace
}  // namespace revisit::engine
