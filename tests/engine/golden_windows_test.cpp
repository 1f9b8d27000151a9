// Convolution, Deconvolution and Pooling with awkward parameters against the original Caffe
// (../shared/golden/zoo), and its verdict on those that cannot be (../shared/golden/parse).
#include <gtest/gtest.h>

#include <algorithm>

#include "compare.h"
#include "revisit/engine/net.h"
#include "revisit/proto/npy.h"
#include "test_data.h"

namespace revisit::engine {
namespace {

namespace fs = std::filesystem;

bool is_ours(const fs::path& file) {
  const std::string name = file.filename().string();
  return name.starts_with("conv_") || name.starts_with("deconv_") || name.starts_with("pool_");
}

void run_case(const fs::path& folder, const PlanOptions& options) {
  const fs::path weights = folder / "weights.caffemodel";
  const Net net = fs::exists(weights) ? Net::load(folder / "net.prototxt", weights)
                                      : Net::load_without_weights(folder / "net.prototxt");
  engine::Run run(net.plan({}, options));
  for (const Port& port : net.inputs()) {
    const proto::NpyArray array = proto::read_npy(folder / ("in_" + port.name + ".npy"));
    std::copy(array.data.begin(), array.data.end(), run.input(port.name).data);
  }
  run.forward();
  for (const std::string& name : net.outputs()) {
    const proto::NpyArray wanted = proto::read_npy(folder / ("out_" + name + ".npy"));
    const View<const float> found = run.output(name);
    EXPECT_EQ(found.shape, Shape(wanted.shape)) << name;
    EXPECT_LE(test::relative_error(found.values(), wanted.data), 5e-6) << name;
  }
}

TEST(GoldenWindows, AgreeWithCaffe) {
  REVISIT_NEED_SHARED(zoo, "golden/zoo");
  int cases = 0;
  for (const auto& entry : fs::directory_iterator(zoo)) {
    if (!entry.is_directory() || !is_ours(entry.path())) continue;
    SCOPED_TRACE(entry.path().filename());
    run_case(entry.path(), {.threads = 2});
    run_case(entry.path(), {.reference_kernels = true});
    ++cases;
  }
  EXPECT_GE(cases, 38);
}

TEST(GoldenWindows, RefuseWhatCaffeRefuses) {
  REVISIT_NEED_SHARED(parse, "golden/parse");
  int refused = 0;
  for (const auto& entry : fs::directory_iterator(parse)) {
    if (!is_ours(entry.path())) continue;
    SCOPED_TRACE(entry.path().filename());
    if (entry.path().stem() == "conv_kernel_gt_input_s2_trunc") {
      EXPECT_EQ(Net::load_without_weights(entry.path()).plan().outputs()[0].shape,
                (Shape{1, 4, 1, 4}));
      continue;
    }
    EXPECT_THROW(Net::load_without_weights(entry.path()), Error);
    ++refused;
  }
  EXPECT_GE(refused, 17);
}

}  // namespace
}  // namespace revisit::engine
