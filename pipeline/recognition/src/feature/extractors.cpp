#include <algorithm>
#include <memory>

#include "revisit/proto/text.h"
#include "revisit/recognition/feature.h"

namespace revisit::pipeline {
namespace {

/// Everything about an image's geometry that pixel values depend on.
std::string geometry_key(const ImageGeometry& g) {
  const ClosingRectangle closing = closing_rectangle(g);
  return str("geometry ", g.width, "x", g.height, " elevation ", g.elevation_top, "..",
             g.elevation_bottom, " max_range ", g.max_range, " closing ", closing.width, "x",
             closing.height);
}

/// The only input of the net, at the size of the image.
engine::Port image_input(const engine::Net& net, const ImageGeometry& geometry) {
  if (net.inputs().size() != 1)
    throw InputError(str("the net '", net.name(), "' has ", net.inputs().size(),
                         " inputs; a net for range images has one"));
  const engine::Port& port = net.inputs()[0];
  if (port.shape.rank() != 4 || (port.shape[1] != 1 && port.shape[1] != 3))
    throw InputError(str("the input '", port.name, "' of the net '", net.name(), "' is ",
                         port.shape,
                         "; a net for range images takes 1 x 3 x h x w (or 1 channel)"));
  return {port.name, engine::Shape{1, port.shape[1], geometry.height, geometry.width}};
}

/// One mean for each of 3 channels, or that of the gray image for the only one.
std::vector<double> means_of(const std::array<double, 3>& bgr, int64_t channels) {
  if (channels == 3) return {bgr.begin(), bgr.end()};
  return {0.114 * bgr[0] + 0.587 * bgr[1] + 0.299 * bgr[2]};
}

/// All channels are the range image, less the mean of each: they differ from the first by
/// constants.
std::vector<float> offsets_to_first(const std::vector<double>& means, double scale) {
  std::vector<float> offsets;
  for (const double mean : means) offsets.push_back(static_cast<float>((means[0] - mean) * scale));
  return offsets;
}

}  // namespace

FeatureExtractor network_features(const engine::Net& net, const std::string& net_key,
                                  const std::array<double, 3>& mean_bgr,
                                  const ImageGeometry& geometry, int threads, double input_scale) {
  const engine::Port all = image_input(net, geometry);
  engine::PlanOptions options{.threads = threads};
  const std::vector<double> means = means_of(mean_bgr, all.shape[1]);
  if (net.takes_gray_input()) options.gray_offsets = offsets_to_first(means, input_scale);
  const engine::Plan plan = net.plan({{all.name, all.shape}}, options);
  const engine::Port input = plan.inputs()[0];  // one channel, or all
  if (plan.outputs().size() != 1)
    throw UsageError(str("the net '", net.name(), "' has ", plan.outputs().size(),
                         " outputs; choose the layer that is the feature by Truncation::end"));
  FeatureExtractor extractor;
  extractor.name = plan.outputs()[0].name;
  extractor.dim = plan.outputs()[0].shape.elements();
  extractor.key = str(net_key, "\nlayer ", extractor.name, "\nmean_bgr ", exact(mean_bgr[0]), " ",
                      exact(mean_bgr[1]), " ", exact(mean_bgr[2]), " scale ", exact(input_scale),
                      "\n", geometry_key(geometry));
  extractor.make = [plan, input, means, input_scale]() -> FeatureFunction<RangeImage> {
    auto run = std::make_shared<engine::Run>(plan);
    return [run, input, means, scale = static_cast<float>(input_scale)](const RangeImage& image,
                                                                        std::span<float> feature) {
      float* channel = run->input(input.name).data;
      for (int64_t c = 0; c < input.shape[1]; ++c) {
        const auto mean = static_cast<float>(means[static_cast<size_t>(c)]);
        channel = std::transform(image.pixels.begin(), image.pixels.end(), channel,
                                 [mean, scale](float pixel) { return (pixel - mean) * scale; });
      }
      run->forward();
      const auto output = run->output(run->plan().outputs()[0].name).values();
      std::copy(output.begin(), output.end(), feature.begin());
    };
  };
  return extractor;
}

FeatureExtractor range_vector_features(const ImageGeometry& geometry) {
  FeatureExtractor extractor;
  extractor.name = "data";
  extractor.dim = int64_t{geometry.width} * geometry.height;
  extractor.key = "data\n" + geometry_key(geometry);
  extractor.make = []() -> FeatureFunction<RangeImage> {
    return [](const RangeImage& image, std::span<float> feature) {
      std::copy(image.pixels.begin(), image.pixels.end(), feature.begin());
    };
  };
  return extractor;
}

RangeImage scan_to_image(const PointCloud& cloud, AlignCase mode, const ImageGeometry& geometry) {
  Eigen::Matrix3f R_image_sensor = Eigen::Matrix3f::Identity();
  if (mode != AlignCase::kNone) R_image_sensor = principal_alignment(cloud, mode).R_aligned_sensor;
  RangeImage image;
  project_turned(cloud, R_image_sensor, geometry, image);
  close_holes_in_place(image, geometry);
  return image;
}

}  // namespace revisit::pipeline
