#include "revisit/engine/net.h"
#include "single_layer.h"
#include "testing.h"

namespace revisit::engine {
namespace {

TEST(Filter, KeepsSelectedRows) {
  const auto found = run_layer({.type = "Filter",
                                .param = "",
                                .inputs = {{Shape{4, 2}, {1, 2, 3, 4, 5, 6, 7, 8}},
                                           {Shape{4}, {10, 20, 30, 40}},
                                           {Shape{4, 1, 1, 1}, {-0.0F, 1, kNan, 0}}},
                                .n_outputs = 2});
  EXPECT_EQ(found[0].shape, (Shape{2, 2}));
  expect_near(found[0].values, {3, 4, 5, 6});
  expect_near(found[1].values, {20, 30});
}

TEST(Filter, RejectsInvalidParameters) {
  const auto infer = [](std::vector<Shape> inputs, size_t n_outputs) {
    return [=] { layer_of("Filter", "")->infer(inputs, n_outputs); };
  };
  expect_error<InputError>(infer({Shape{4}}, 0), {"at least 2 inputs"});
  expect_error<InputError>(infer({Shape{4, 2}, Shape{4}}, 2), {"expected 1 outputs"});
  expect_error<InputError>(infer({Shape{4, 2}, Shape{4, 2}}, 1), {"one number for each item"});
  expect_error<InputError>(infer({Shape{4, 2}, Shape{3}}, 1), {"3 items", "4x2"});
}

/// For layers with keeps_items(), a single item must yield the same result.
TEST(KeepsItems, IsTrueOfTheLayersThatSaySo) {
  const std::map<std::string, std::string> params{
      {"Concat", "concat_param { axis: 2 }"},
      {"Convolution", "convolution_param { num_output: 3 kernel_size: 3 }"},
      {"Deconvolution", "convolution_param { num_output: 3 kernel_size: 3 stride: 2 }"},
      {"InnerProduct", "inner_product_param { num_output: 5 }"},
      {"Interp", "interp_param { zoom_factor: 2 }"},
      {"Permute", "permute_param { order: 0 order: 2 }"},
      {"Pooling", "pooling_param { kernel_size: 2 stride: 2 }"},
      {"Reduction", "reduction_param { axis: 1 }"},
      {"ShuffleChannel", "shuffle_channel_param { group: 2 }"},
      {"SPP", "spp_param { pyramid_height: 2 }"}};
  const Shape shape{3, 4, 5, 6};
  const std::vector<float> values = test::random_floats(shape.elements(), 1);
  std::set<std::string> tested;
  for (const auto& [type, origin, does] : layer_types()) {
    if (type == "Input") continue;
    const auto given = params.find(type);
    const std::string param = given == params.end() ? "" : given->second;
    const auto run = [&, type = type](int64_t first, int64_t items, size_t n_inputs) {
      const auto begin = values.begin() + first * shape.product(1, 4);
      const Tensor input{shape.with(0, items), {begin, begin + items * shape.product(1, 4)}};
      test::SingleLayer l{type, param, std::vector<Tensor>(n_inputs, input)};
      for (const Shape& weights :
           layer_of(type, param)->weight_shapes(std::vector<Shape>(n_inputs, input.shape)))
        l.weights.push_back(test::random_floats(weights.elements(), 2));
      return run_layer(l)[0].values;
    };
    size_t n_inputs = 0;
    try {
      const auto layer = layer_of(type, param);
      n_inputs = type == "Eltwise" || type == "Concat" ? 2 : 1;
      const std::vector<Shape> inputs(n_inputs, shape);
      layer->infer(inputs, 1);
      if (layer->output_memory() == OutputMemory::kViewOfInput || !layer->keeps_items(0, inputs))
        continue;
    } catch (const Error&) {
      continue;
    }
    const std::vector<float> together = run(0, 3, n_inputs);
    std::vector<float> apart;
    for (int64_t item = 0; item < 3; ++item) {
      const std::vector<float> one = run(item, 1, n_inputs);
      apart.insert(apart.end(), one.begin(), one.end());
    }
    SCOPED_TRACE(type);
    expect_near(apart, together, 1e-5F);
    tested.insert(type);
  }
  for (const auto& [type, param] : params) EXPECT_TRUE(tested.contains(type)) << type;
  EXPECT_GT(tested.size(), 30U);
}

TEST(KeepsItems, IsFalseWhereItemsMeet) {
  const auto expect_false = [](const std::string& type, const std::string& param) {
    EXPECT_FALSE(layer_of(type, param)->keeps_items(0, {Shape{3, 4, 5, 6}})) << type;
  };
  expect_false("BatchNorm", "batch_norm_param { use_global_stats: false }");
  expect_false("Concat", "concat_param { axis: -4 }");
  expect_false("Convolution", "convolution_param { num_output: 3 kernel_size: 1 axis: 0 }");
  expect_false("InnerProduct", "inner_product_param { num_output: 3 axis: 0 }");
  expect_false("Permute", "permute_param { order: 1 }");
  expect_false("Reduction", "");
  expect_false("ROIPooling", "roi_pooling_param { pooled_h: 1 pooled_w: 1 }");
  expect_false("Scale", "scale_param { axis: 0 }");
  expect_false("Slice", "slice_param { axis: 0 }");
  expect_false("Softmax", "softmax_param { axis: 0 }");
}

class FilterNet : public testing::Test {
 protected:
  /// `more` follows the filter, which keeps rows of 3x2x2.
  Net load(const std::string& more) {
    write_file(dir_ / "net.prototxt", R"(
      layer { name: "in" type: "Input" top: "data" top: "keep"
              input_param { shape { dim: 3 dim: 2 dim: 2 } shape { dim: 3 } } }
      layer { name: "filter" type: "Filter" bottom: "data" bottom: "keep" top: "kept" }
    )" + more);
    return Net::load_without_weights(dir_ / "net.prototxt");
  }
  static void forward(engine::Run& run, const std::vector<float>& keep) {
    for (size_t i = 0; i < 12; ++i) run.input("data").data[i] = static_cast<float>(i);
    std::copy(keep.begin(), keep.end(), run.input("keep").data);
    run.forward();
  }
  static std::vector<float> values(const engine::Run& run, const std::string& name) {
    const auto view = run.output(name).values();
    return {view.begin(), view.end()};
  }
  const TempDir dir_;
};

TEST_F(FilterNet, TheOutputHasTheRowsOfTheLastPass) {
  engine::Run run(load("").plan());
  EXPECT_EQ(run.plan().outputs()[0].shape, (Shape{3, 2, 2}));  // the maximum
  forward(run, {1, 0, 1});
  EXPECT_EQ(run.output("kept").shape, (Shape{2, 2, 2}));
  EXPECT_EQ(values(run, "kept"), (std::vector<float>{0, 1, 2, 3, 8, 9, 10, 11}));
  forward(run, {0, 1, 0});
  EXPECT_EQ(values(run, "kept"), (std::vector<float>{4, 5, 6, 7}));
  forward(run, {0, 0, 0});
  EXPECT_EQ(run.output("kept").shape.text(), "0x2x2");
  EXPECT_TRUE(run.output("kept").values().empty());
}

TEST_F(FilterNet, ViewsFollowTheRows) {
  const Net net = load(R"(
    layer { name: "drop" type: "Dropout" bottom: "kept" top: "kept" }
    layer { name: "split" type: "Split" bottom: "kept" top: "a" top: "b" }
    layer { name: "flat" type: "Flatten" bottom: "a" top: "flat" flatten_param { axis: 1 } }
    layer { name: "line" type: "Flatten" bottom: "b" top: "line" flatten_param { axis: 0 } }
  )");
  engine::Run run(net.plan({}, {.keep_all = true}));
  forward(run, {0, 1, 1});
  EXPECT_EQ(run.output("flat").shape, (Shape{2, 4}));
  EXPECT_EQ(run.output("line").shape, (Shape{8}));
  EXPECT_EQ(run.layer_output("drop").shape, (Shape{2, 2, 2}));
  EXPECT_EQ(values(run, "line"), (std::vector<float>{4, 5, 6, 7, 8, 9, 10, 11}));
}

TEST_F(FilterNet, LayersThatComputeEachRowFollowThem) {
  engine::Run run(load(R"(
    layer { name: "flat" type: "Flatten" bottom: "kept" top: "flat" }
    layer { name: "power" type: "Power" bottom: "flat" top: "power" power_param { shift: 1 } }
    layer { name: "sum" type: "Eltwise" bottom: "flat" bottom: "power" top: "sum" }
  )")
                      .plan());
  forward(run, {0, 1, 0});
  EXPECT_EQ(run.output("sum").shape, (Shape{1, 4}));
  EXPECT_EQ(values(run, "sum"), (std::vector<float>{9, 11, 13, 15}));
  forward(run, {0, 0, 0});
  EXPECT_EQ(run.output("sum").shape.text(), "0x4");
}

TEST_F(FilterNet, OthersDoNot) {
  const auto refuse = [&](const std::string& more, std::initializer_list<std::string> words) {
    const Net net = load(more);
    expect_error<UnsupportedError>([&] { net.plan(); }, words);
  };
  refuse(R"(layer { name: "soft" type: "Softmax" bottom: "kept" top: "soft"
                    softmax_param { axis: 0 } })",
         {"'soft'", "'kept'", "'filter'", "each row"});
  refuse(R"(layer { name: "sum" type: "Eltwise" bottom: "kept" bottom: "data" top: "sum" })",
         {"'sum'", "does not scale with it"});
  refuse(R"(layer { name: "again" type: "Filter" bottom: "data" bottom: "keep" top: "again" }
            layer { name: "sum" type: "Eltwise" bottom: "kept" bottom: "again" top: "sum" })",
         {"'sum'", "each row"});
  refuse(R"(layer { name: "fixed" type: "Reshape" bottom: "kept" top: "fixed"
                    reshape_param { shape { dim: 3 dim: 4 } } })",
         {"'fixed'", "does not scale with it"});
  refuse(R"(layer { name: "two" type: "Reshape" bottom: "kept" top: "two"
                    reshape_param { shape { dim: 2 dim: -1 } } }
            layer { name: "relu" type: "ReLU" bottom: "two" top: "relu" })",
         {"'relu'", "each row"});
  const Net net = load(R"(
    layer { name: "flat" type: "Flatten" bottom: "kept" top: "flat" }
    layer { name: "soft" type: "Softmax" bottom: "flat" top: "soft" softmax_param { axis: 0 } }
  )");
  expect_error<UnsupportedError>(
      [&] { net.plan(); },
      {"net.prototxt", "'soft'", "'flat'", "'filter'", "end the net before this layer"});
  const Net cut = Net::load_without_weights(dir_ / "net.prototxt", {.end = "flat"});
  EXPECT_EQ(cut.plan().outputs()[0].shape, (Shape{3, 4}));
}

TEST_F(FilterNet, RowsBelongToTheRun) {
  const Plan plan = load("").plan();
  engine::Run a(plan), b(plan);
  forward(a, {1, 1, 1});
  forward(b, {0, 0, 1});
  EXPECT_EQ(a.output("kept").shape, (Shape{3, 2, 2}));
  EXPECT_EQ(b.output("kept").shape, (Shape{1, 2, 2}));
}

TEST(FilterNetWithTwoOutputs, BothMayEndInSilence) {
  const TempDir dir;
  write_file(dir / "net.prototxt", R"(
    layer { name: "in" type: "Input" top: "x" top: "y" top: "chosen" input_param {
      shape { dim: 3 dim: 2 } shape { dim: 3 dim: 1 } shape { dim: 3 } } }
    layer { name: "filter" type: "Filter" bottom: "x" bottom: "y" bottom: "chosen"
            top: "kept_x" top: "kept_y" }
    layer { name: "silence" type: "Silence" bottom: "kept_x" bottom: "kept_y" }
  )");
  EXPECT_NO_THROW(Net::load_without_weights(dir / "net.prototxt").plan());
}

TEST(DetectorNet, TheOutputHasARowForEachDetection) {
  const TempDir dir;
  write_file(dir / "net.prototxt", R"(
    layer { name: "in" type: "Input" top: "map" top: "image" top: "loc" top: "conf" input_param {
      shape { dim: 1 dim: 1 dim: 1 dim: 2 } shape { dim: 1 dim: 1 dim: 4 dim: 8 }
      shape { dim: 1 dim: 8 } shape { dim: 1 dim: 4 } } }
    layer { name: "prior" type: "PriorBox" bottom: "map" bottom: "image" top: "prior"
            prior_box_param { min_size: 4 } }
    layer { name: "detect" type: "DetectionOutput" bottom: "loc" bottom: "conf" bottom: "prior"
            top: "found" detection_output_param { num_classes: 2 confidence_threshold: 0.5 } }
    layer { name: "flat" type: "Flatten" bottom: "found" top: "flat" }
  )");
  const Net net = Net::load_without_weights(dir / "net.prototxt");
  engine::Run run(net.plan({}, {.keep_all = true}));
  std::fill_n(run.input("loc").data, 8, 0.0F);
  const auto detect = [&](const std::vector<float>& confidences) {
    std::copy(confidences.begin(), confidences.end(), run.input("conf").data);
    run.forward();
    EXPECT_EQ(run.output("flat").shape[1], run.layer_output("detect").shape[2] * 7);
    const auto view = run.layer_output("detect").values();
    return std::vector<float>(view.begin(), view.end());
  };
  EXPECT_EQ(detect({0, 0.75F, 0, 1}),
            (std::vector<float>{0, 1, 1, 0.5F, 0, 1, 1, 0, 1, 0.75F, 0, 0, 0.5F, 1}));
  EXPECT_EQ(detect({0, 0.75F, 0, 0}), (std::vector<float>{0, 1, 0.75F, 0, 0, 0.5F, 1}));
  EXPECT_EQ(detect({0, 0, 0, 0}), (std::vector<float>{0, -1, -1, -1, -1, -1, -1}));
}

TEST(RecurrentNet, StateBelongsToTheRun) {
  const TempDir dir;
  write_file(dir / "net.prototxt", R"(
    layer { name: "in" type: "Input" top: "x" top: "cont"
            input_param { shape { dim: 1 dim: 1 dim: 1 } shape { dim: 1 dim: 1 } } }
    layer { name: "lstm" type: "LSTM" bottom: "x" bottom: "cont" top: "y"
            recurrent_param { num_output: 3 } }
    layer { name: "relu" type: "ReLU" bottom: "y" top: "y" }
  )");
  const Plan plan = Net::load_with_random_weights(dir / "net.prototxt", 1).plan();
  const auto pass = [](engine::Run& run) {
    run.input("x").data[0] = 1;
    run.input("cont").data[0] = 1;
    run.forward();
    const auto view = run.output("y").values();
    return std::vector<float>(view.begin(), view.end());
  };
  engine::Run a(plan), b(plan);
  const auto first = pass(a), second = pass(a);
  EXPECT_NE(first, second);
  EXPECT_EQ(pass(b), first);
  EXPECT_EQ(pass(b), second);
}

}  // namespace
}  // namespace revisit::engine
