#include "net_case.h"
#include "simd_targets.h"
#include "testing.h"

namespace revisit::engine {
namespace {

const std::string kFast = "fastest predicted", kAmplified = "rounding amplified later";

const LayerCost& cost_of(const Plan& plan, const std::string& name) {
  for (const LayerCost& layer : plan.layers())
    if (layer.name == name) return layer;
  throw std::runtime_error("no layer " + name);
}

/// 4x4 tiles are not the fastest for these convolutions.
Net two_convolutions(const std::string& between, const std::string& after) {
  return test::small_net({1, 64, 56, 56},
                         test::conv("a", "data", "num_output: 64 kernel_size: 3 pad: 1") + between +
                             test::conv("b", "a", "num_output: 64 kernel_size: 3 pad: 1") + after,
                         {}, test::Weights::kNone);
}

TEST(KernelChoice, IsLimitedBeforeLayersThatAmplifyRounding) {
  REVISIT_NEED_BLOCKED_KERNELS();
  const auto why = [](const Net& net, const PlanOptions& options = {}) {
    const Plan plan = net.plan({}, options);
    return std::pair(cost_of(plan, "a").selection_reason, cost_of(plan, "b").selection_reason);
  };
  const auto both = [](const std::string& reason) { return std::pair(reason, reason); };
  const Net plain = two_convolutions("", ""),
            map = two_convolutions("", test::in_place("s", "Softmax", "b"));
  EXPECT_EQ(why(plain), both(kFast));
  EXPECT_EQ(why(map), both(kAmplified));
  for (const char* averaging :
       {"type: 'InnerProduct' inner_product_param { num_output: 10 }",
        "type: 'Pooling' pooling_param { pool: AVE global_pooling: true }"}) {
    const Net classifier =
        two_convolutions("", str("layer { name: 'm' bottom: 'b' top: 'm' ", averaging, " }\n") +
                                 test::in_place("s", "Softmax", "m"));
    EXPECT_EQ(why(classifier), both(kFast)) << averaging;
    EXPECT_EQ(cost_of(classifier.plan(), "a").kernel, cost_of(plain.plan(), "a").kernel);
  }
  EXPECT_EQ(why(plain, {.strict_accuracy = true}), both("strict accuracy"));
  EXPECT_EQ(why(plain, {.reference_kernels = true}), both("reference requested"));

  for (const char* type : {"BatchNorm", "MVN"}) {
    SCOPED_TRACE(type);
    const Net later = two_convolutions("", test::in_place("n", type, "b"));
    EXPECT_EQ(why(later), both(kAmplified));
    EXPECT_EQ(why(later, {.keep_all = true}), both(kAmplified));
    EXPECT_EQ(why(two_convolutions(test::in_place("n", type, "a"), "")),
              std::pair(kAmplified, kFast));
  }
  const std::string centered = "mvn_param { normalize_variance: false }";
  EXPECT_EQ(why(two_convolutions("", test::in_place("n", "MVN", "b", centered))), both(kFast));
}

/// Rounding passes through layers without effect, and on one of two branches.
TEST(KernelChoice, FollowsTheValuesOfAConvolution) {
  REVISIT_NEED_BLOCKED_KERNELS();
  const Net net = test::small_net(
      {1, 64, 56, 56},
      test::conv("a", "data", "num_output: 64 kernel_size: 3 pad: 1") +
          test::layer("d", "Dropout", {"a"}, "") + test::layer("f", "Flatten", {"d"}, "") +
          test::layer("m", "MVN", {"f"}, "") +
          test::conv("b", "data", "num_output: 64 kernel_size: 3 pad: 1"),
      {}, test::Weights::kNone);
  EXPECT_EQ(cost_of(net.plan(), "a").selection_reason, kAmplified);
  EXPECT_EQ(cost_of(net.plan(), "b").selection_reason, kFast);
}

TEST(LayerCosts, OfLayersThatOnlyMoveOrChooseValuesAreExact) {
  const Net net = test::small_net(
      {1, 32, 8, 8},
      test::layer("max", "Pooling", {"data"}, "pooling_param { kernel_size: 2 }") +
          test::layer("mean", "Pooling", {"data"}, "pooling_param { pool: AVE kernel_size: 2 }") +
          test::in_place("relu", "ReLU", "mean") + test::layer("f", "Flatten", {"max"}) +
          test::layer("c", "Concat", {"max", "mean"}) + test::layer("s", "Slice", {"data"}) +
          test::layer("t", "TanH", {"c"}),
      {}, test::Weights::kNone);
  for (const LayerCost& layer : net.plan().layers())
    EXPECT_EQ(layer.exact, layer.name != "mean" && layer.name != "t") << layer.name;
}

struct KnownNet {
  const char *file, *end;  // in data/nets; LoadOptions::end, "" for none
  int64_t height, width;
};

std::string table_of(const KnownNet& known) {
  const Net net =
      Net::load_without_weights(test::shared("data/nets") / known.file, {.end = known.end});
  const Shape input{1, 3, known.height, known.width};
  std::ostringstream table;
  table << known.file << (*known.end ? " to " : "") << known.end << " " << input << "\n";
  const Plan plan = net.plan({{net.inputs()[0].name, input}});
  for (const LayerCost& layer : plan.layers())
    if (layer.type == "Convolution")
      table << "  " << layer.name << ": " << layer.kernel << " (" << layer.selection_reason
            << ")\n";
  return table.str();
}

/// Changes of the cost model fail here. If intended, replace the file by the text found.
TEST(KernelChoice, OfKnownNets) {
  REVISIT_NEED_SHARED(nets, "data/nets");
  const std::string wanted = read_file(test::fixture("chosen_kernels.txt"));
  for (const int64_t target : {int64_t{HWY_AVX3}, int64_t{HWY_AVX2}}) {
    if ((hwy::SupportedTargets() & HWY_TARGETS & target) == 0) continue;
    SCOPED_TRACE(hwy::TargetName(target));
    hwy::SetSupportedTargetsForTest(target);
    std::string found;
    for (const KnownNet& known : {KnownNet{"bvlc_alexnet_deploy.prototxt", "", 227, 227},
                                  {"bvlc_alexnet_deploy.prototxt", "pool5", 107, 4000},
                                  {"VGG_CNN_S_deploy.prototxt", "", 224, 224},
                                  {"VGG_CNN_S_deploy.prototxt", "pool5", 107, 4000},
                                  {"places_cnds8_deploy.prototxt", "", 227, 227},
                                  {"VGG_ILSVRC_16_layers_deploy.prototxt", "", 224, 224}})
      found += table_of(known);
    hwy::SetSupportedTargetsForTest(0);
    EXPECT_EQ(found, wanted);
  }
}

TEST(KernelChoice, AlexNetWithItsSoftmaxIsAsFastAsItsTrunk) {
  REVISIT_NEED_BLOCKED_KERNELS();
  REVISIT_NEED_SHARED(nets, "data/nets");
  const auto file = nets / "bvlc_alexnet_deploy.prototxt";
  const Plan whole = Net::load_without_weights(file).plan();
  const Plan trunk = Net::load_without_weights(file, {.end = "pool5"}).plan();
  for (const char* name : {"conv2", "conv3", "conv4", "conv5"})
    EXPECT_EQ(cost_of(whole, name).kernel, cost_of(trunk, name).kernel) << name;
  EXPECT_TRUE(cost_of(whole, "conv2").winograd);
}

}  // namespace
}  // namespace revisit::engine
