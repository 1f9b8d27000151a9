// Fast against reference kernels, evaluated by descriptors of a trained network.
#include "float_matrix.h"
#include "revisit/datasets/describe.h"
#include "revisit/datasets/scan_file.h"
#include "revisit/engine/net.h"
#include "revisit/recognition/feature_file.h"
#include "testing.h"

namespace revisit {
namespace {

constexpr std::array<double, 3> kMeanBgr = {104, 117, 123};

engine::Net squeezenet(const fs::path& folder) {
  return engine::Net::load(folder / "deploy.prototxt", folder / "weights.caffemodel",
                           {.end = "fire6/concat", .graft = "pool8"});
}

std::vector<float> reference_feature(const engine::Net& net, const RangeImage& image) {
  engine::Run run(
      net.plan({{"data", {1, 3, image.height, image.width}}}, {.reference_kernels = true}));
  float* channel = run.input("data").data;
  for (const double mean : kMeanBgr)
    channel = std::transform(image.pixels.begin(), image.pixels.end(), channel,
                             [&](float pixel) { return pixel - static_cast<float>(mean); });
  run.forward();
  const auto values = run.output(run.plan().outputs()[0].name).values();
  return {values.begin(), values.end()};
}

TEST(FastDescriptor, IsTheReferencesOnRealScans) {
  REVISIT_NEED_SHARED(scans, "data/kitti/sequences/00/velodyne");
  REVISIT_NEED_SHARED(model, "data/caffemodels/squeezenet_v1.0");
  const ImageGeometry geometry{.width = 1000, .height = 56};
  const engine::Net net = squeezenet(model);
  const FeatureExtractor extractor = network_features(net, "squeezenet", kMeanBgr, geometry);
  const auto fast = std::get<FeatureMaker<RangeImage>>(extractor.make)();

  std::vector<RangeImage> images;
  for (const auto& entry : fs::directory_iterator(scans))
    images.push_back(scan_to_image(read_scan(entry.path()), AlignCase::kOne, geometry));
  const auto n = static_cast<int64_t>(images.size());
  ASSERT_GE(n, 12);

  const TempDir dir;
  FeatureWriter writer(dir / "features.npy", "both", 2 * n, extractor.dim);
  std::vector<float> feature(static_cast<size_t>(extractor.dim));
  for (const RangeImage& image : images) {
    fast(image, feature);
    writer.append(feature);
  }
  for (const RangeImage& image : images) writer.append(reference_feature(net, image));
  writer.finish();

  const FeatureFile file(dir / "features.npy");
  PcaOptions options;
  for (int64_t i = n; i < 2 * n; ++i) options.fit_rows.push_back(i);
  const FloatMatrix descriptors = fit_pca({&file}, options).descriptors;
  for (int64_t i = 0; i < n; ++i)
    EXPECT_GE(test::cosine_of(descriptors.row(i), descriptors.row(n + i)), 0.999999)
        << "scan " << i;
}

}  // namespace
}  // namespace revisit
