// The first byte determines the format, as in files: 'p' begins a PLY, '#' or a header word a PCD;
// all else is KITTI's .bin.
#include <cmath>
#include <span>

#include "fuzz.h"
#include "revisit/baselines/baselines.h"
#include "revisit/datasets/describe.h"
#include "revisit/datasets/scan_file.h"

namespace revisit::fuzz {
namespace {

const char* extension_of(const std::string& bytes) {
  if (bytes.starts_with('p')) return ".ply";
  constexpr std::string_view kPcdStarts = "#VFCSTWHPD";
  return !bytes.empty() && kPcdStarts.find(bytes[0]) != std::string_view::npos ? ".pcd" : ".bin";
}

void make_images(const PointCloud& cloud) {
  ImageGeometry geometry;
  geometry.width = 40;
  geometry.height = 8;
  for (const AlignCase mode : {AlignCase::kNone, AlignCase::kOne, AlignCase::kTwo})
    works_or_refuses([&] { scan_to_image(cloud, mode, geometry); });
}

void make_features(const PointCloud& cloud) {
  using namespace revisit;
  FeatureExtractor (*const makers[])() = {
      [] { return scan_context_features(); }, [] { return m2dp_features(); },
      [] { return vfh_features(); }, [] { return grsd_features(); }, [] { return esf_features(); }};
  const bool with_esf = cloud.points.size() % 8 == 0;  // it takes 20 ms for any scan
  for (const auto& make : std::span(makers).first(with_esf ? 5 : 4))
    works_or_refuses([&] {
      const FeatureExtractor extractor = make();  // throws in a build without PCL
      std::vector<float> feature(static_cast<size_t>(extractor.dim));
      std::get<FeatureMaker<PointCloud>>(extractor.make)()(cloud, feature);
      for (const float value : feature) require(std::isfinite(value), "features are finite");
    });
}

}  // namespace
}  // namespace revisit::fuzz

extern "C" int LLVMFuzzerTestOneInput(const uint8_t* data, size_t size) {
  using namespace revisit;
  const std::string bytes = fuzz::text(data, size);
  const fuzz::InputFile file(bytes, fuzz::extension_of(bytes));
  fuzz::works_or_refuses([&] {
    const PointCloud cloud = read_scan(file.path());
    fuzz::require(!cloud.points.empty(), "a scan that is read has points");
    fuzz::make_images(cloud);
    fuzz::make_features(cloud);
  });
  return 0;
}
