// References: outputs of the original Caffe (../shared/golden, ../shared/data).
#include "net_case.h"
#include "revisit/engine/net.h"
#include "revisit/proto/npy.h"
#include "testing.h"

namespace revisit::engine {
namespace {

proto::Blob read(const fs::path& file) {
  return proto::read_npy(file);
}

Run forward(const Net& net, const proto::Blob& input, const PlanOptions& options = {}) {
  const std::string& blob = net.inputs().at(0).name;
  Run run(net.plan({{blob, Shape(input.shape)}}, options));
  std::copy(input.data.begin(), input.data.end(), run.input(blob).data);
  run.forward();
  return run;
}

void expect_value(const Run& run, const View<const float>& found, const fs::path& golden) {
  const proto::Blob wanted = read(golden);
  EXPECT_EQ(found.shape, Shape(wanted.shape)) << golden;
  EXPECT_LE(relative_error(found.values(), wanted.data), test::tolerance_of(run.plan())) << golden;
}

void expect_output(const Run& run, const std::string& name, const fs::path& golden) {
  expect_value(run, run.output(name), golden);
}

struct Trunk {
  std::string net, weights;  // folders
};

class GoldenTrunk : public testing::TestWithParam<Trunk> {};

TEST_P(GoldenTrunk, EveryVariantAndSize) {
  REVISIT_NEED_SHARED(golden, "golden");
  const fs::path folder = golden / "nets" / GetParam().net;
  const fs::path weights = golden / "nets" / GetParam().weights / "weights.caffemodel";
  int cases = 0;
  for (const std::string variant : {"pool5", "conv3+pool5", "conv4+pool5"})
    for (const std::string suffix : {"", "_v1"}) {
      const fs::path prototxt = folder / (variant + suffix + ".prototxt");
      if (!fs::exists(prototxt)) continue;
      const Net net = Net::load(prototxt, weights);
      for (const std::string size : {"64x160", "64x900", "107x4000"}) {
        const fs::path wanted = folder / ("out_" + variant + "_" + size + ".npy");
        if (!fs::exists(wanted)) continue;
        const engine::Run run =
            forward(net, read(golden / "inputs" / ("in_1x3x" + size + ".npy")), {.threads = 2});
        expect_output(run, net.outputs().at(0), wanted);
        ++cases;
      }
    }
  EXPECT_GE(cases, 8);
}

TEST_P(GoldenTrunk, GraftOnTheWholeTrunkGivesTheVariants) {
  REVISIT_NEED_SHARED(golden, "golden");
  const fs::path folder = golden / "nets" / GetParam().net;
  const fs::path weights = golden / "nets" / GetParam().weights / "weights.caffemodel";
  for (const std::string end : {"conv3", "conv4"}) {
    const Net net = Net::load(folder / "pool5.prototxt", weights, {.end = end, .graft = "pool5"});
    const engine::Run run = forward(net, read(golden / "inputs/in_1x3x64x900.npy"));
    expect_output(run, end + "+pool5", folder / ("out_" + end + "+pool5_64x900.npy"));
  }
}

TEST_P(GoldenTrunk, LayerByLayer) {
  REVISIT_NEED_SHARED(golden, "golden");
  const fs::path folder = golden / "nets" / GetParam().net;
  const Net net = Net::load(folder / "pool5.prototxt",
                            golden / "nets" / GetParam().weights / "weights.caffemodel");
  const engine::Run run =
      forward(net, read(golden / "inputs/in_1x3x64x160.npy"), {.keep_all = true});
  int layers = 0;
  for (const auto& entry : fs::directory_iterator(folder / "all_64x160")) {
    const std::string stem = entry.path().stem().string();  // 005_conv2.0
    const std::string layer = stem.substr(4, stem.rfind('.') - 4);
    if (layer == "input") continue;  // added by the upgrade of `input:` fields
    expect_value(run, run.layer_output(layer), entry.path());
    ++layers;
  }
  EXPECT_GE(layers, 14);
}

TEST_P(GoldenTrunk, ReferenceKernelsAgreeToo) {
  REVISIT_NEED_SHARED(golden, "golden");
  const fs::path folder = golden / "nets" / GetParam().net;
  const Net net = Net::load(folder / "conv3+pool5.prototxt",
                            golden / "nets" / GetParam().weights / "weights.caffemodel");
  const engine::Run run =
      forward(net, read(golden / "inputs/in_1x3x64x160.npy"), {.reference_kernels = true});
  expect_output(run, net.outputs().at(0), folder / "out_conv3+pool5_64x160.npy");
}

TEST_P(GoldenTrunk, SameBitsForAnyNumberOfThreads) {
  REVISIT_NEED_SHARED(golden, "golden");
  const fs::path folder = golden / "nets" / GetParam().net;
  const Net net = Net::load(folder / "pool5.prototxt",
                            golden / "nets" / GetParam().weights / "weights.caffemodel");
  const proto::Blob input = read(golden / "inputs/in_1x3x64x900.npy");
  const engine::Run one = forward(net, input, {.threads = 1});
  const auto wanted = one.output("pool5").values();
  for (const int threads : {2, 3, 5}) {
    const engine::Run run = forward(net, input, {.threads = threads});
    const auto found = run.output("pool5").values();
    EXPECT_TRUE(std::equal(found.begin(), found.end(), wanted.begin(), wanted.end()))
        << threads << " threads";
  }
}

INSTANTIATE_TEST_SUITE_P(Nets, GoldenTrunk,
                         testing::Values(Trunk{"alexnet", "alexnet"}, Trunk{"caffenet", "alexnet"},
                                         Trunk{"vgg_cnn_s", "vgg_cnn_s"}),
                         [](const auto& instance) { return instance.param.net; });

std::array<size_t, 3> best_three(std::span<const float> scores) {
  std::vector<size_t> order(scores.size());
  for (size_t i = 0; i < order.size(); ++i) order[i] = i;
  std::partial_sort(order.begin(), order.begin() + 3, order.end(),
                    [&](size_t a, size_t b) { return scores[a] > scores[b]; });
  return {order[0], order[1], order[2]};
}

TEST(SqueezeNet, RecognizesTheCatAlsoInBf16) {
  REVISIT_NEED_SHARED(folder, "data/caffemodels/squeezenet_v1.0");
  const Net net = Net::load(folder / "deploy.prototxt", folder / "weights.caffemodel");
  constexpr std::array<size_t, 3> kCats = {278, 277, 263};
  const engine::Run run = forward(net, read(folder / "in.npy"), {.keep_all = true});
  expect_value(run, run.layer_output("pool_final"), folder / "out_pool_final.npy");
  EXPECT_EQ(best_three(run.layer_output("pool_final").values()), kCats);
  const engine::Run bf16 = forward(net, read(folder / "in.npy"), {.precision = Precision::kBf16});
  EXPECT_EQ(best_three(bf16.output(net.outputs().at(0)).values()), kCats);
}

TEST(SqueezeNet, PanoramaSizedInput) {
  REVISIT_NEED_SHARED(folder, "data/caffemodels/squeezenet_v1.0");
  const Net net = Net::load(folder / "deploy.prototxt", folder / "weights.caffemodel");
  const engine::Run run =
      forward(net, read(folder / "112x1000/in.npy"), {.threads = 2, .keep_all = true});
  expect_value(run, run.layer_output("pool4"), folder / "112x1000/out_pool4.npy");
  expect_value(run, run.layer_output("pool8"), folder / "112x1000/out_pool8.npy");
}

TEST(TrainedModels, OfEarlyCaffe) {
  REVISIT_NEED_SHARED(models, "data/caffemodels");
  for (const char* name : {"lenet_v1_2014", "lenet_v1_older", "cifar10_quick_v1",
                           "cifar10_full_v1_lrn_within", "cifar10_quick_h5"}) {
    SCOPED_TRACE(name);
    const bool hdf5 = std::string_view(name).ends_with("h5");
    const Net net =
        Net::load(models / name / "deploy.prototxt",
                  models / name / (hdf5 ? "weights.caffemodel.h5" : "weights.caffemodel"));
    const engine::Run run = forward(net, read(models / name / "in.npy"));
    const proto::Blob wanted = read(models / name / "out_prob.npy");
    const auto found = run.output("prob").values();
    ASSERT_EQ(found.size(), wanted.data.size());
    // Softmax 1e-6; after Winograd kernels a tenth of their tolerance.
    const double tolerance = std::max(test::tolerance_of(run.plan(), 0) / 10, 1e-6);
    for (size_t i = 0; i < found.size(); ++i) EXPECT_NEAR(found[i], wanted.data[i], tolerance);
  }
}

/// Default plans with all fusions, because `net verify` keeps every layer, which disables them.
TEST(SlimNets, FusedPlansEqualTheReference) {
  REVISIT_NEED_SHARED(slim, "golden/slim");
  for (const auto& entry : fs::directory_iterator(slim)) {
    if (!entry.is_directory()) continue;
    SCOPED_TRACE(entry.path().filename());
    test::expect_as_reference(
        Net::load(entry.path() / "deploy.prototxt", entry.path() / "weights.caffemodel"));
  }
}

}  // namespace
}  // namespace revisit::engine
