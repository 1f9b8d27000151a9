// Results must match the reference kernels without fusion.
#include "net_case.h"
#include "simd_targets.h"
#include "single_layer.h"
#include "testing.h"

namespace revisit::engine {
namespace {

const Shape kFuseData{1, 16, 9, 11};

struct NamedActivation {
  const char *name, *type, *param;
};

class FusedActivation : public testing::TestWithParam<NamedActivation> {};

TEST_P(FusedActivation, IsDoneByTheConvolution) {
  const Net net = small_net(kFuseData, conv("c", "data") +
                                           in_place("a", GetParam().type, "c", GetParam().param) +
                                           conv("next", "c"));
  EXPECT_EQ(kernel_of(expect_as_reference(net), "a"), "in c");
  EXPECT_NE(kernel_of(net.plan({}, {.keep_all = true}), "a"), "in c");
  EXPECT_NE(kernel_of(net.plan({}, {.reference_kernels = true}), "a"), "in c");
}

TEST_P(FusedActivation, OnAConvolutionThatHasNoBlockedKernel) {
  const Net net = small_net(
      {2, 6, 9, 11},
      conv("c", "data", "num_output: 4 kernel_size: 3 pad: 2 dilation: 2 stride: 2 group: 2") +
          in_place("a", GetParam().type, "c", GetParam().param));
  EXPECT_EQ(kernel_of(expect_as_reference(net), "a"), "in c");
}

INSTANTIATE_TEST_SUITE_P(
    Types, FusedActivation,
    testing::Values(NamedActivation{"ReLU", "ReLU", ""},
                    NamedActivation{"LeakyReLU", "ReLU", "relu_param { negative_slope: 0.3 }"},
                    NamedActivation{"PReLU", "PReLU", ""},
                    NamedActivation{"SharedPReLU", "PReLU", "prelu_param { channel_shared: true }"},
                    NamedActivation{"ELU", "ELU", "elu_param { alpha: 0.7 }"},
                    NamedActivation{"ReLU6", "ReLU6", ""}),
    [](const auto& instance) { return std::string(instance.param.name); });

TEST(Fuse, NotAcrossAValueThatIsReadTwice) {
  REVISIT_NEED_BLOCKED_KERNELS();
  const Net net = small_net(kFuseData, conv("c", "data") + layer("a", "ReLU", {"c"}) +
                                           layer("both", "Concat", {"c", "a"}));
  EXPECT_EQ(kernel_of(expect_as_reference(net), "a"), "activation");
}

TEST(Fuse, NotAcrossAValueThatIsAnOutput) {
  // With an end at c, the ReLU is removed; with a graft, it comes in between.
  const std::string layers = conv("c", "data") + in_place("a", "ReLU", "c") +
                             layer("p", "Pooling", {"c"}, "pooling_param { kernel_size: 2 }");
  const Net cut = small_net(kFuseData, layers, "c");
  EXPECT_EQ(expect_as_reference(cut).layers().size(), 2U);
  const Net grafted = small_net(kFuseData, layers, "c+p");
  EXPECT_EQ(kernel_of(expect_as_reference(grafted), "a"), "in c");
  const Net at_relu = small_net(kFuseData, layers, "a");
  EXPECT_EQ(kernel_of(expect_as_reference(at_relu), "a"), "in c");
}

TEST(Fuse, OnlyOneActivationAndNoScaleAfterIt) {
  REVISIT_NEED_BLOCKED_KERNELS();
  const Net net = small_net(kFuseData, conv("c", "data") + in_place("a", "ReLU", "c") +
                                           in_place("b", "ELU", "c") + in_place("s", "Scale", "c"));
  const Plan plan = expect_as_reference(net);
  EXPECT_EQ(kernel_of(plan, "a"), "in c");
  EXPECT_EQ(kernel_of(plan, "b"), "activation");
  EXPECT_EQ(kernel_of(plan, "s"), "scale");
}

TEST(Fuse, LayersThatChangeNothingAreGone) {
  const Net net = small_net(
      kFuseData, conv("c", "data") + in_place("drop", "Dropout", "c") + in_place("a", "ReLU", "c") +
                     "layer { name: 'split' type: 'Split' bottom: 'c' top: 's1' top: 's2' }" +
                     conv("c1", "s1") + conv("c2", "s2") + layer("sum", "Eltwise", {"c1", "c2"}) +
                     in_place("drop2", "Dropout", "sum"));
  const Plan plan = expect_as_reference(net);
  EXPECT_EQ(kernel_of(plan, "a"), "in c");
  EXPECT_EQ(kernel_of(plan, "drop"), "");
  EXPECT_EQ(kernel_of(plan, "split"), "");
  EXPECT_EQ(plan.outputs().size(), 1U);
}

TEST(FusedAffine, BatchNormScaleAndBiasGoIntoTheWeights) {
  const Net net = small_net(
      kFuseData, conv("c", "data") + in_place("bn", "BatchNorm", "c") +
                     in_place("s", "Scale", "c", "scale_param { bias_term: true }") +
                     in_place("b", "Bias", "c") + in_place("a", "PReLU", "c") +
                     conv("d", "c", "num_output: 32 kernel_size: 1 bias_term: false group: 2") +
                     in_place("s2", "Scale", "d", "scale_param { axis: 0 num_axes: 0 }"));
  const Plan plan = expect_as_reference(net);
  for (const char* name : {"bn", "s", "b", "a"}) EXPECT_EQ(kernel_of(plan, name), "in c");
  EXPECT_EQ(kernel_of(plan, "s2"), "in d");
  for (const char* name : {"bn", "s", "b", "a"})
    EXPECT_NE(kernel_of(net.plan({}, {.keep_all = true}), name), "in c");
}

TEST(FusedAffine, BnGoesIntoTheWeightsUnlessItIsOfTheBatch) {
  const Net net = small_net(
      kFuseData, conv("c", "data") + in_place("pspnet", "BN", "c") + conv("d", "c") +
                     in_place("segnet", "BN", "d", "bn_param { bn_mode: INFERENCE }") +
                     conv("e", "d") + layer("batch", "BN", {"e"}, "bn_param { bn_mode: LEARN }"));
  const Plan plan = expect_as_reference(net);
  EXPECT_EQ(kernel_of(plan, "pspnet"), "in c");
  EXPECT_EQ(kernel_of(plan, "segnet"), "in d");
  EXPECT_EQ(kernel_of(plan, "batch"), "bn-of-batch");
}

TEST(FusedAffine, TakesOneNumberPerChannel) {
  const Net net = small_net(
      {1, 16, 9, 16},
      conv("c", "data", "num_output: 16 kernel_size: 1") +
          layer("rows", "Scale", {"c"}, "scale_param { axis: 3 }") +
          conv("d", "rows", "num_output: 16 kernel_size: 1") +
          layer("given", "Scale", {"d", "c"}, "scale_param { axis: 0 }") +
          conv("e", "given", "num_output: 16 kernel_size: 1") +
          layer("batch", "BatchNorm", {"e"}, "batch_norm_param { use_global_stats: false }"));
  const Plan plan = expect_as_reference(net);
  EXPECT_EQ(kernel_of(plan, "rows"), "scale");
  EXPECT_EQ(kernel_of(plan, "given"), "scale");
  EXPECT_EQ(kernel_of(plan, "batch"), "batch-norm-of-batch");
}

TEST(FusedAffine, WeightsOfOtherShapesAreRefusedFirst) {
  const Net net =
      small_net(kFuseData, layer("bn", "BatchNorm", {"data"}) + in_place("s", "Scale", "bn"));
  expect_error<InputError>(
      [&] {
        net.plan({{"data", Shape{1, 24, 9, 11}}});
      },
      {"'bn'", "blob 0", "24"});
}

TEST(FusedAffine, WithoutAConvolutionIntoOneAnother) {
  REVISIT_NEED_BLOCKED_KERNELS();
  // Pattern of DenseNet, in NCHWc, and in NCHW before the first NCHWc layer.
  for (const bool blocked : {true, false}) {
    const Net net = small_net(
        {2, 16, 9, 11}, (blocked ? conv("c", "data") : layer("c", "TanH", {"data"})) +
                            layer("bn", "BatchNorm", {"c"}) +
                            in_place("s", "Scale", "bn", "scale_param { bias_term: true }") +
                            in_place("a", "PReLU", "bn") + layer("both", "Concat", {"bn", "c"}));
    const Plan plan = expect_as_reference(net);
    EXPECT_EQ(kernel_of(plan, "bn"), blocked ? "scale" : "batch-norm");
    EXPECT_EQ(kernel_of(plan, "s"), "in bn");
    EXPECT_EQ(kernel_of(plan, "a"), "in bn");
  }
}

TEST(FusedSum, TakesTheActivationAfterIt) {
  for (const bool blocked : {true, false}) {
    const std::string two = blocked ? conv("x", "data") + conv("y", "data")
                                    : layer("x", "TanH", {"data"}) + layer("y", "Exp", {"data"});
    const Net net = small_net(
        kFuseData, two + layer("m", "Eltwise", {"x", "y"}, "eltwise_param { operation: MAX }") +
                       in_place("a", "ELU", "m") +
                       layer("p", "Eltwise", {"m", "x"}, "eltwise_param { operation: PROD }") +
                       in_place("b", "PReLU", "p") +
                       layer("s", "Eltwise", {"p", "y"}, "eltwise_param { coeff: 0.5 coeff: -2 }") +
                       in_place("c", "ReLU", "s"));
    const Plan plan = expect_as_reference(net);
    EXPECT_EQ(kernel_of(plan, "a"), "in m");
    EXPECT_EQ(kernel_of(plan, "b"), "in p");
    EXPECT_EQ(kernel_of(plan, "c"), "in s");
  }
}

TEST(FusedSum, OfValuesThatAreNoImages) {
  for (const Shape& shape : {Shape{7}, Shape{3, 5}, Shape{2, 3, 4}}) {
    const Net net =
        small_net(shape, layer("t", "TanH", {"data"}) + layer("s", "Eltwise", {"data", "t"}) +
                             in_place("r", "ReLU", "s"));
    EXPECT_EQ(kernel_of(expect_as_reference(net), "r"), "in s");
  }
}

TEST(FusedSum, IsDoneByTheLaterConvolution) {
  for (const auto& inputs : {std::vector<std::string>{"c1", "c2"}, {"c2", "c1"}}) {
    const Net net =
        small_net(kFuseData, conv("c0", "data") + conv("c1", "c0") + conv("c2", "c0") +
                                 in_place("bn", "BatchNorm", "c2") +
                                 layer("sum", "Eltwise", inputs) + in_place("a", "ReLU", "sum"));
    const Plan plan = expect_as_reference(net);
    EXPECT_EQ(kernel_of(plan, "bn"), "in c2");
    EXPECT_EQ(kernel_of(plan, "sum"), "in c2");
    EXPECT_EQ(kernel_of(plan, "a"), "in c2");
  }
}

TEST(FusedSum, ShortcutAroundTwoConvolutions) {
  const Net net =
      small_net({2, 16, 9, 11}, conv("c1", "data", "num_output: 16 kernel_size: 3 pad: 1") +
                                    in_place("a1", "ReLU", "c1") +
                                    conv("c2", "c1", "num_output: 16 kernel_size: 3 pad: 1") +
                                    layer("sum", "Eltwise", {"data", "c2"}) +
                                    in_place("a2", "ReLU", "sum") + conv("c3", "sum"));
  const Plan plan = expect_as_reference(net);
  EXPECT_EQ(kernel_of(plan, "sum"), "in c2");
  EXPECT_EQ(kernel_of(plan, "a2"), "in c2");
}

TEST(FusedSum, NotOfOtherSums) {
  const std::string two = conv("c1", "data") + conv("c2", "data");
  const auto kernel = [&](const std::string& layers) {
    return kernel_of(expect_as_reference(small_net(kFuseData, two + layers)), "sum");
  };
  EXPECT_EQ(kernel(layer("sum", "Eltwise", {"c1", "c2", "c1"})), "sum");
  EXPECT_EQ(kernel(layer("sum", "Eltwise", {"c2", "c2"})), "sum");
  EXPECT_EQ(kernel(layer("sum", "Eltwise", {"c1", "c2"}, "eltwise_param { coeff: 1 coeff: -1 }")),
            "sum");
  EXPECT_EQ(kernel(layer("sum", "Eltwise", {"c1", "c2"}, "eltwise_param { operation: MAX }")),
            "maximum");
  // The later convolution has an activation already; the earlier one runs before the addend exists.
  EXPECT_EQ(kernel(in_place("a", "ReLU", "c2") + layer("sum", "Eltwise", {"c1", "c2"})), "sum");
  // Another layer reads c2.
  EXPECT_EQ(kernel(layer("sum", "Eltwise", {"c1", "c2"}) + layer("p", "Power", {"c2"})), "sum");
  // Nothing can be multiplied after the sum.
  const Net net = small_net(
      kFuseData, two + layer("sum", "Eltwise", {"c1", "c2"}) + in_place("s", "Scale", "sum"));
  EXPECT_EQ(kernel_of(expect_as_reference(net), "s"), "scale");
}

TEST(FusedLrn, WithTheMaximumPoolingAfterIt) {
  REVISIT_NEED_BLOCKED_KERNELS();
  const std::string norm = layer("n", "LRN", {"c"}, "lrn_param { local_size: 3 alpha: 0.5 k: 2 }");
  const std::string pool = "pooling_param { kernel_size: 3 stride: 2 pad: 1 }";
  const Net net =
      small_net(kFuseData, conv("c", "data") + norm + layer("p", "Pooling", {"n"}, pool));
  EXPECT_EQ(kernel_of(expect_as_reference(net), "p"), "in n");

  const auto kernel = [&](const std::string& layers) {
    return kernel_of(expect_as_reference(small_net(kFuseData, conv("c", "data") + layers)), "p");
  };
  EXPECT_EQ(
      kernel(norm + layer("p", "Pooling", {"n"}, "pooling_param { pool: AVE kernel_size: 3 }")),
      "average-pool");
  EXPECT_EQ(kernel(norm + layer("p", "Pooling", {"n"}, pool) + layer("x", "Power", {"n"})),
            "max-pool");
  EXPECT_EQ(kernel(norm + "layer { name: 'p' type: 'Pooling' bottom: 'n' top: 'p' top: 'mask' " +
                   pool + "}"),
            "max-pool");
  EXPECT_EQ(kernel(layer("n", "LRN", {"c"}, "lrn_param { norm_region: WITHIN_CHANNEL }") +
                   layer("p", "Pooling", {"n"}, pool)),
            "max-pool");
}

/// A few channels stay NCHW: one channel in 16 lanes takes 16 times the memory.
TEST(FusedLrn, NotWhereBlocksAreMostlyPadding) {
  REVISIT_NEED_BLOCKED_KERNELS();
  const std::string layers =
      layer("n", "LRN", {"data"}, "lrn_param { local_size: 3 alpha: 0.5 k: 2 }") +
      layer("p", "Pooling", {"n"}, "pooling_param { kernel_size: 3 stride: 2 }");
  const Net net = small_net({1, 1, 400, 500}, layers);
  const Plan plan = expect_as_reference(net);
  EXPECT_EQ(kernel_of(plan, "p"), "max-pool");
  EXPECT_LE(plan.arena_bytes(), net.plan({}, {.keep = {"n"}}).arena_bytes());
  EXPECT_EQ(kernel_of(expect_as_reference(small_net({1, 8, 9, 11}, layers)), "p"), "in n");
}

/// With 512 channels a strip has 32 columns, so that overlapping wide windows would recompute
/// theirs.
TEST(FusedPooling, NotWhereStripsMakeTheSameColumnsAgain) {
  REVISIT_NEED_BLOCKED_KERNELS();
  const auto kernel = [](const std::string& layers, const std::string& window) {
    return kernel_of(
        expect_as_reference(small_net(
            {1, 3, 12, 80}, conv("c", "data", "num_output: 512 kernel_size: 1") + layers + window)),
        "p");
  };
  const auto pool = [](const std::string& bottom, const std::string& param) {
    return layer("p", "Pooling", {bottom}, "pooling_param { kernel_h: 3 " + param + " }");
  };
  EXPECT_EQ(kernel("", pool("c", "kernel_w: 31 stride: 1 pad_h: 0 pad_w: 15")), "max-pool");
  EXPECT_EQ(kernel("", pool("c", "kernel_w: 5 stride: 2")), "in c");
  EXPECT_EQ(kernel("", pool("c", "kernel_w: 80 stride: 1")), "in c");  // one strip
  // After another layer it is not the first convolution.
  const std::string later = in_place("s", "Sigmoid", "c") +
                            conv("d", "c", "num_output: 512 kernel_size: 1 group: 32") +
                            layer("n", "LRN", {"d"});
  EXPECT_EQ(kernel(later, pool("n", "kernel_w: 31 stride: 1 pad_h: 0 pad_w: 15")), "max-pool");
  EXPECT_EQ(kernel(later, pool("n", "kernel_w: 5 stride: 2")), "in n");
}

TEST(FusedFirstConvolution, OnlyTheFirstOfTwoPoolings) {
  REVISIT_NEED_BLOCKED_KERNELS();
  const Shape data{1, 3, 41, 53};
  const std::string first = conv("c", "data", "num_output: 24 kernel_size: 5 stride: 2 pad: 1");
  const std::string p = layer("p", "Pooling", {"c"}, "pooling_param { kernel_size: 3 stride: 2 }");
  const std::string pool = "pooling_param { kernel_size: 2 stride: 2 }";
  const Plan plain =
      expect_as_reference(small_net(data, first + p + layer("q", "Pooling", {"p"}, pool)));
  EXPECT_EQ(kernel_of(plain, "p"), "in c");
  EXPECT_EQ(kernel_of(plain, "q"), "max-pool");
  const Plan normed = expect_as_reference(
      small_net(data, first + p + layer("n", "LRN", {"p"}) + layer("q", "Pooling", {"n"}, pool)));
  EXPECT_EQ(kernel_of(normed, "p"), "in c");
  EXPECT_EQ(kernel_of(normed, "q"), "in n");
}

TEST(FusedFirstConvolution, OnAnInputThatOthersReadInBlocks) {
  REVISIT_NEED_BLOCKED_KERNELS();
  const std::string pool = "pooling_param { kernel_size: 3 stride: 2 }";
  const Net net = small_net({1, 3, 21, 33}, conv("a", "data", "num_output: 16 kernel_size: 1") +
                                                layer("b", "Concat", {"a", "data"}) +
                                                conv("c", "data", "num_output: 16 kernel_size: 3") +
                                                layer("p", "Pooling", {"c"}, pool));
  EXPECT_EQ(kernel_of(expect_as_reference(net), "p"), "in c");
}

/// Fusion fixes the chosen kernel: a kernel without pooling must not write a full convolution into
/// the smaller buffer of the pooled output.
TEST(FusedFirstConvolution, WithoutItsKernelIsRefused) {
  const auto layer = test::layer_of(
      "Convolution", "convolution_param { num_output: 1 kernel_size: 1 bias_term: false }");
  const std::vector<Shape> data{{1, 1, 8, 8}}, pooled{{1, 1, 4, 4}};
  const std::vector<Tensor> weights{{{1, 1, 1, 1}, {1}}};
  Binding binding{data, pooled, weights};
  binding.fusion.pooling.emplace();
  EXPECT_THROW(layer->bind(binding), std::logic_error);
}

TEST(FusedFirstConvolution, IsNoLayerWithoutInputs) {
  const std::string shape = "shape { dim: 1 dim: 2 dim: 4 dim: 6 }";
  for (const auto& [type, param] :
       std::map<std::string, std::string>{{"DummyData", "dummy_data_param { " + shape + " }"},
                                          {"Parameter", "parameter_param { " + shape + " }"}}) {
    const Net net = small_net(
        kFuseData, layer("c", type, {}, param) +
                       layer("p", "Pooling", {"c"}, "pooling_param { kernel_size: 2 stride: 2 }"));
    EXPECT_EQ(kernel_of(expect_as_reference(net), "p"), "max-pool") << type;
  }
}

TEST(FusedFirstConvolution, WithNormalizationAndPooling) {
  REVISIT_NEED_BLOCKED_KERNELS();
  const std::string norm = layer("n", "LRN", {"c"}, "lrn_param { local_size: 3 alpha: 0.5 k: 2 }");
  const std::string pool = "pooling_param { kernel_size: 3 stride: 2 }";
  for (const int64_t n : {1, 2}) {
    const Shape data{n, 3, 21, 33};
    const std::string first = conv("c", "data", "num_output: 24 kernel_size: 5 stride: 2 pad: 1") +
                              in_place("a", "PReLU", "c");
    const Plan both =
        expect_as_reference(small_net(data, first + norm + layer("p", "Pooling", {"n"}, pool)));
    for (const char* name : {"a", "n", "p"}) EXPECT_EQ(kernel_of(both, name), "in c");
    const Plan pooled = expect_as_reference(
        small_net(data, first + layer("p", "Pooling", {"c"}, pool) + conv("next", "p")));
    for (const char* name : {"a", "p"}) EXPECT_EQ(kernel_of(pooled, name), "in c");
    const Plan normed = expect_as_reference(small_net(data, first + norm));
    EXPECT_EQ(kernel_of(normed, "n"), "lrn-across");
    // Another layer reads c, c is not the first convolution, or the input has too many channels.
    const Plan twice = expect_as_reference(
        small_net(data, first + layer("p", "Pooling", {"c"}, pool) + layer("q", "TanH", {"c"})));
    EXPECT_EQ(kernel_of(twice, "p"), "max-pool");
    const Plan second = expect_as_reference(
        small_net(data, first + conv("d", "c") + layer("p", "Pooling", {"d"}, pool)));
    EXPECT_EQ(kernel_of(second, "p"), "max-pool");
    const Plan wide =
        expect_as_reference(small_net({n, 16, 21, 33}, first + layer("p", "Pooling", {"c"}, pool)));
    EXPECT_EQ(kernel_of(wide, "p"), "max-pool");
  }
}

}  // namespace
}  // namespace revisit::engine
