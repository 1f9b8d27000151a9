// References: outputs of the original Caffe (tests/golden/zoo). Unsupported layer types fail.
#include "revisit/engine/net.h"
#include "revisit/proto/net_file.h"
#include "revisit/proto/npy.h"
#include "simd_targets.h"
#include "testing.h"

namespace revisit::engine {
namespace {

/// tests/golden/README.md.
constexpr double kRelative = 1e-5;
constexpr double kSoftmaxAbsolute = 1e-6;

std::vector<std::string> cases() {
  std::vector<std::string> names;
  for (const auto& entry : fs::directory_iterator(test::golden("zoo")))
    if (entry.is_directory()) names.push_back(entry.path().filename());
  std::sort(names.begin(), names.end());
  return names;
}

/// Names of files write the `/` of blob names as `_`.
std::string file_name(std::string blob) {
  std::replace(blob.begin(), blob.end(), '/', '_');
  return blob;
}

bool computes_nothing(const caffe::LayerParameter& layer) {
  static constexpr std::array kTypes{"AbsVal",  "ArgMax",  "BatchReindex", "Clip", "Concat",
                                     "Crop",    "Dropout", "Input",        "ReLU", "Reshape",
                                     "Silence", "Slice",   "Threshold",    "Tile", "Flatten"};
  if (layer.type() == "Pooling")
    return layer.pooling_param().pool() == caffe::PoolingParameter::MAX;
  if (layer.type() == "Eltwise")
    return layer.eltwise_param().operation() == caffe::EltwiseParameter::MAX;
  return std::find(kTypes.begin(), kTypes.end(), layer.type()) != kTypes.end();
}

bool made_by_softmax(const caffe::NetParameter& net, const std::string& blob) {
  return std::any_of(net.layer().begin(), net.layer().end(), [&](const auto& layer) {
    return layer.type() == "Softmax" && layer.top(0) == blob;
  });
}

double largest_difference(std::span<const float> a, std::span<const float> b) {
  double worst = 0;
  for (size_t i = 0; i < a.size(); ++i) {
    const double difference = std::abs(static_cast<double>(a[i]) - b[i]);
    worst = std::isnan(difference) ? INFINITY : std::max(worst, difference);
  }
  return worst;
}

class GoldenZoo : public testing::TestWithParam<std::string> {
 protected:
  fs::path folder() const { return test::golden("zoo") / GetParam(); }

  Net load() const {
    const fs::path prototxt = folder() / "net.prototxt", weights = folder() / "weights.caffemodel";
    return fs::exists(weights) ? Net::load(prototxt, weights) : Net::load_without_weights(prototxt);
  }

  engine::Run forward(const Net& net, const PlanOptions& options) const {
    std::map<std::string, proto::Blob> arrays;
    std::map<std::string, Shape> shapes;
    for (const Port& port : net.inputs()) {
      arrays[port.name] = proto::read_npy(folder() / ("in_" + file_name(port.name) + ".npy"));
      shapes[port.name] = Shape(arrays[port.name].shape);
    }
    engine::Run run(net.plan(shapes, options));
    for (const auto& [blob, array] : arrays)
      std::copy(array.data.begin(), array.data.end(), run.input(blob).data);
    run.forward();
    return run;
  }

  int count_files(const std::string& prefix) const {
    int n = 0;
    for (const auto& entry : fs::directory_iterator(folder()))
      n += entry.path().filename().string().starts_with(prefix);
    return n;
  }
};

TEST_P(GoldenZoo, AsTheOriginal) {
  const caffe::NetParameter description = proto::read_net(folder() / "net.prototxt").net;
  const bool exact =
      std::all_of(description.layer().begin(), description.layer().end(), computes_nothing);
  const Net net = load();
  EXPECT_EQ(static_cast<int>(net.inputs().size()), count_files("in_"));
  EXPECT_EQ(static_cast<int>(net.outputs().size()), count_files("out_"));
  double worst = 0;
  test::for_each_simd_target([&] {
    for (const PlanOptions& options : {PlanOptions{.threads = 1}, PlanOptions{.threads = 2},
                                       PlanOptions{.reference_kernels = true}}) {
      SCOPED_TRACE(str(options.threads, " threads, reference ", options.reference_kernels));
      const engine::Run run = forward(net, options);
      for (const std::string& blob : net.outputs()) {
        const auto wanted = proto::read_npy(folder() / ("out_" + file_name(blob) + ".npy"));
        const View<const float> found = run.output(blob);
        ASSERT_EQ(found.shape, Shape(wanted.shape)) << blob;
        const double error = relative_error(found.values(), wanted.data);
        worst = std::max(worst, error);
        if (made_by_softmax(description, blob))
          EXPECT_LE(largest_difference(found.values(), wanted.data), kSoftmaxAbsolute) << blob;
        else
          EXPECT_LE(error, exact ? 0 : kRelative) << blob;
      }
    }
  });
  RecordProperty("worst_relative_error", str(worst));
}

INSTANTIATE_TEST_SUITE_P(Cases, GoldenZoo, testing::ValuesIn(cases()),
                         [](const auto& instance) { return instance.param; });

}  // namespace
}  // namespace revisit::engine
