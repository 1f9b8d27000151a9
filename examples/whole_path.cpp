// The paper's method (section III) step by step, from scans to a recognized place: finds the scan
// taken at the same place as the last one. `tests/consumer` builds it against the installed
// libraries.
//   whole_path NET.prototxt NET.caffemodel SCAN SCAN [SCAN...]
#include <revisit/datasets/scan_file.h>
#include <revisit/recognition/feature.h>
#include <revisit/recognition/feature_file.h>
#include <revisit/recognition/place_index.h>
#include <revisit/recognition/range_image.h>

#include <iostream>
#include <numeric>

int main(int argc, char** argv) try {
  using namespace revisit;
  if (argc < 5) return 2;
  const std::vector<std::string> scans(argv + 3, argv + argc);
  const auto n = static_cast<int64_t>(scans.size());
  const ImageGeometry geometry = sensor_geometry("hdl64");  // 4000 x 112
  const auto net = revisit::engine::Net::load(argv[1], argv[2]);
  const FeatureExtractor network = network_features(net, argv[2], {104, 117, 123}, geometry);
  const auto feature_of = std::get<FeatureMaker<RangeImage>>(network.make)();

  const std::string key = std::accumulate(scans.begin(), scans.end(), std::string(argv[2]));
  FeatureWriter writer("features", key, n, network.dim);  // resumes after an interruption
  std::vector<float> feature(static_cast<size_t>(network.dim));
  for (int64_t i = writer.rows_written(); i < n; ++i) {
    const PointCloud scan = read_scan(scans[static_cast<size_t>(i)]);
    const Alignment alignment = principal_alignment(scan);
    const PointCloud aligned = rotated(scan, alignment.R_aligned_sensor);
    const RangeImage image = project(aligned, geometry);
    feature_of(close_holes(image, geometry), feature);  // the network's first layers
    writer.append(feature);
  }
  writer.finish();

  const FeatureFile features("features");
  const FloatMatrix descriptors = fit_pca({&features}, {.components = 400}).descriptors;
  PlaceIndex index(descriptors.d);  // the last scan is the query, all others are stored
  for (int64_t i = 0; i + 1 < n; ++i) index.add(descriptors.row(i));
  const CandidateRange all{0, n - 1};
  const Match match = index.best(descriptors.row(n - 1), {&all, 1});  // by cosine
  // The score s = 2 c1 - ck is high if the best match is similar and distinct: accept above a
  // threshold.
  std::cout << scans.back() << " is where " << scans[static_cast<size_t>(match.ranks[0])]
            << " was taken, score " << match.score << "\n";
} catch (const std::exception& error) {
  std::cerr << error.what() << "\n";
  return 1;
}
