// Describes a scan with a network: what a user of the libraries writes.
//   consumer SCAN PROTOTXT
#include <revisit/datasets/scan_file.h>
#include <revisit/engine/net.h>
#include <revisit/recognition/feature.h>
#include <revisit/recognition/sensor.h>

#include <iostream>

int main(int argc, char** argv) {
  if (argc != 3) return 2;
  using namespace revisit::pipeline;
  const ImageGeometry geometry = sensor_geometry("hdl64");
  const auto net = revisit::engine::Net::load_with_random_weights(argv[2], 1);
  const FeatureExtractor feature = network_features(net, "random", {0, 0, 0}, geometry);
  const RangeImage image = scan_to_image(read_scan(argv[1]), AlignCase::kOne, geometry);
  std::vector<float> values(static_cast<size_t>(feature.dim));
  std::get<FeatureMaker<RangeImage>>(feature.make)()(image, values);
  std::cout << feature.name << ": " << feature.dim << " numbers\n";
}
