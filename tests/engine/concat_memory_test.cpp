#include "net_case.h"
#include "testing.h"

namespace revisit::engine {
namespace {

const Shape kConcatData{1, 16, 12, 16};

std::string concat_kernel(const Shape& data, const std::string& layers) {
  return kernel_of(expect_as_reference(small_net(data, layers)), "all");
}

TEST(Concat, InputsAreMadeInPlace) {
  const std::string layers = conv("a", "data") + in_place("ra", "ReLU", "a") +
                             conv("b", "data", "num_output: 19 kernel_size: 1") +
                             layer("all", "Concat", {"a", "b"}) + conv("next", "all");
  EXPECT_EQ(concat_kernel(kConcatData, layers), "in place");
  EXPECT_EQ(concat_kernel({2, 16, 12, 16}, layers), "copy") << "images of a batch alternate";
  const Plan plan = small_net(kConcatData, layers).plan();
  for (const LayerCost& layer : plan.layers())
    if (layer.name == "all") {
      EXPECT_EQ(layer.activation_bytes, 0);
    }
}

TEST(Concat, PlainValuesToo) {
  EXPECT_EQ(concat_kernel(kConcatData, layer("a", "TanH", {"data"}) + layer("b", "Exp", {"data"}) +
                                           layer("all", "Concat", {"a", "b"}) +
                                           in_place("r", "ReLU", "all")),
            "in place");
  EXPECT_EQ(concat_kernel({1, 3, 5, 7}, layer("a", "TanH", {"data"}) + layer("b", "Exp", {"data"}) +
                                            layer("all", "Concat", {"a", "b"})),
            "copy")
      << "b would not start on a cache line";
}

TEST(Concat, NestedOnes) {
  EXPECT_EQ(
      concat_kernel(kConcatData, conv("a", "data") + conv("b", "a") +
                                     layer("inner", "Concat", {"a", "b"}) + conv("c", "inner") +
                                     layer("all", "Concat", {"inner", "c"}) + conv("d", "all")),
      "in place");
}

TEST(Concat, CopiesInputsThatAreReadTwice) {
  const std::string two = conv("a", "data") + conv("b", "data");
  EXPECT_EQ(concat_kernel(kConcatData, two + layer("all", "Concat", {"a", "a", "b"})), "copy");
  EXPECT_EQ(concat_kernel(kConcatData, two + layer("other", "Concat", {"b", "a"}) +
                                           layer("all", "Concat", {"a", "b"}) +
                                           layer("sum", "Eltwise", {"all", "other"})),
            "copy");
  EXPECT_EQ(concat_kernel(kConcatData,
                          layer("a", "TanH", {"data"}) + layer("all", "Concat", {"data", "a"})),
            "copy")
      << "inputs of the net keep their place";
}

TEST(Concat, ChannelsThatDoNotFillABlockAreCopiedPlain) {
  EXPECT_EQ(concat_kernel(kConcatData, conv("a", "data", "num_output: 19 kernel_size: 1") +
                                           conv("b", "data") + layer("all", "Concat", {"a", "b"}) +
                                           conv("next", "all")),
            "in place")
      << "one after another in plain layout";
}

TEST(Concat, PartsCanBeReadBeforeAndAfter) {
  // ra works in place on part a; p and q read parts late; the ReLU works in place on the
  // concatenation after the last reader of parts.
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
    const Net net = small_net(kConcatData, layers);
    EXPECT_EQ(kernel_of(expect_as_reference(net), "all"), "in place");
    expect_as_reference(net, {.keep_all = true});
  }
}

/// Plans on one and three threads are bitwise equal to a plan that keeps all values and so
/// overwrites none.
void expect_as_kept(const Net& net, const PlanOptions& options) {
  PlanOptions keeping = options;
  keeping.keep_all = true;
  const auto wanted = test::forward(net, keeping);
  for (const int threads : {1, 3}) {
    PlanOptions working = options;
    working.threads = threads;
    for (const auto& [name, tensor] : test::forward(net, working))
      EXPECT_EQ(tensor.values, wanted.at(name).values) << name << ", " << threads << " threads";
  }
}

TEST(WorkInPlace, NotOverAPartThatTheSameLayerReads) {
  // The parts of a Concat lie in its output: here a Bias reads one of them under another shape.
  const std::string parts = layer("a", "Power", {"data"}) +
                            layer("b", "Power", {"data"}, "power_param { scale: 100 }") +
                            layer("c", "Concat", {"a", "b"}, "concat_param { axis: 0 }") +
                            layer("r", "Reshape", {"a"}, "reshape_param { shape { dim: 16 } }");
  for (const bool reference : {false, true}) {
    const PlanOptions options{.reference_kernels = reference};
    expect_as_kept(
        small_net({1, 16}, parts + layer("o", "Bias", {"c", "r"}, "bias_param { axis: 1 }")),
        options);
    expect_as_kept(
        small_net({1, 16}, parts + layer("o", "Scale", {"c", "r"}, "scale_param { axis: 1 }")),
        options);
    // In place on the part, while the layer reads the whole.
    expect_as_kept(
        small_net({1, 16}, layer("a", "Power", {"data"}, "power_param { scale: 3 }") +
                               layer("c", "Concat", {"a"}) +
                               layer("r", "Reshape", {"c"}, "reshape_param { shape { dim: 16 } }") +
                               layer("o", "Bias", {"a", "r"}, "bias_param { axis: 1 }")),
        options);
  }
}

TEST(WorkInPlace, TheBiasOfTwoRowsByTheFirst) {
  const TempDir dir;
  write_file(dir / "net.prototxt", R"(
    layer { name: "in" type: "Input" top: "x" top: "y" input_param { shape { dim: 1 dim: 16 } } }
    layer { name: "a" type: "Power" bottom: "x" top: "a" power_param { shift: 0 scale: 1 } }
    layer { name: "b" type: "Power" bottom: "y" top: "b" power_param { shift: 0 scale: 1 } }
    layer { name: "c" type: "Concat" bottom: "a" bottom: "b" top: "c" concat_param { axis: 0 } }
    layer { name: "r" type: "Reshape" bottom: "a" top: "r" reshape_param { shape { dim: 16 } } }
    layer { name: "o" type: "Bias" bottom: "c" bottom: "r" top: "o" bias_param { axis: 1 } })");
  engine::Run run(Net::load_without_weights(dir / "net.prototxt").plan());
  std::vector<float> wanted(32);
  for (int i = 0; i < 16; ++i) {
    const auto x = static_cast<float>(i + 1), y = 100 * x;
    run.input("x").data[i] = x;
    run.input("y").data[i] = y;
    wanted[i] = x + x;
    wanted[16 + i] = y + x;
  }
  run.forward();
  const auto values = run.output("o").values();
  EXPECT_EQ(std::vector<float>(values.begin(), values.end()), wanted);
}

TEST(WorkInPlace, OverAnInputThatIsGivenTwice) {
  const std::string made = layer("a", "TanH", {"data"}) + layer("b", "Exp", {"data"});
  for (const char* operation : {"SUM", "PROD", "MAX"}) {
    const Net net =
        small_net(kConcatData, made + layer("all", "Eltwise", {"a", "b", "a"},
                                            str("eltwise_param { operation: ", operation, " }")));
    expect_as_kept(net, {});
    EXPECT_EQ(net.plan().layers().back().activation_bytes, 0) << operation;
  }
  for (const char* type : {"Scale", "Bias"})
    expect_as_kept(
        small_net(kConcatData, layer("a", "TanH", {"data"}) +
                                   layer("all", type, {"a", "a"},
                                         type == std::string("Scale") ? "scale_param { axis: 0 }"
                                                                      : "bias_param { axis: 0 }")),
        {});
}

}  // namespace
}  // namespace revisit::engine
