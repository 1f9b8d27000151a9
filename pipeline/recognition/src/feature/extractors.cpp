#include <algorithm>
#include <memory>

#include "feature/image_plan.h"
#include "revisit/base/text.h"
#include "revisit/recognition/feature.h"

namespace revisit {
namespace {

engine::Port image_input(const engine::Net& net, int height, int width) {
  if (net.inputs().size() != 1)
    throw InputError("the net '", net.name(), "' has ", net.inputs().size(),
                     " inputs; a net for range images has one");
  const engine::Port& port = net.inputs()[0];
  if (port.shape.rank() != 4 || (port.shape[1] != 1 && port.shape[1] != 3))
    throw InputError("the input '", port.name, "' of the net '", net.name(), "' is ", port.shape,
                     "; a net for range images takes 1 x 3 x h x w (or 1 channel)");
  return {port.name, engine::Shape{1, port.shape[1], height, width}};
}

std::vector<double> means_of(const std::array<double, 3>& bgr, int64_t channels) {
  if (channels == 3) return {bgr.begin(), bgr.end()};
  return {0.114 * bgr[0] + 0.587 * bgr[1] + 0.299 * bgr[2]};
}

std::vector<float> offsets_to_first(const std::vector<double>& means, double scale) {
  std::vector<float> offsets;
  for (const double mean : means) offsets.push_back(static_cast<float>((means[0] - mean) * scale));
  return offsets;
}

std::string geometry_key(const ImageGeometry& g) {
  const auto [closing_width, closing_height] = closing_rectangle(g);
  return str("geometry ", g.width, "x", g.height, " elevation ", g.elevation_top, "..",
             g.elevation_bottom, " max_range ", g.max_range, " closing ", closing_width, "x",
             closing_height);
}

}  // namespace

ImagePlan plan_for_images(const engine::Net& net, int height, int width,
                          const std::array<double, 3>& mean_bgr, double scale,
                          engine::PlanOptions options) {
  const engine::Port all = image_input(net, height, width);
  const std::vector<double> means = means_of(mean_bgr, all.shape[1]);
  if (net.takes_single_channel_input()) options.channel_offsets = offsets_to_first(means, scale);
  const engine::Plan plan = net.plan({{all.name, all.shape}}, options);
  const engine::Port input = plan.inputs()[0];
  return {plan, input, {means.begin(), means.end()}, static_cast<float>(scale)};
}

void ImagePlan::fill(engine::Run& run, std::span<const float> pixels) const {
  float* channel = run.input(input.name).data;
  for (int64_t c = 0; c < input.shape[1]; ++c) {
    const float mean = means[static_cast<size_t>(c)];
    channel = std::transform(pixels.begin(), pixels.end(), channel,
                             [mean, this](float pixel) { return (pixel - mean) * scale; });
  }
}

FeatureExtractor network_features(const engine::Net& net, const std::string& net_key,
                                  const std::array<double, 3>& mean_bgr,
                                  const ImageGeometry& geometry, const engine::PlanOptions& forward,
                                  double input_scale) {
  const ImagePlan images =
      plan_for_images(net, geometry.height, geometry.width, mean_bgr, input_scale,
                      {.threads = forward.threads, .precision = forward.precision});
  const engine::Plan& plan = images.plan;
  if (plan.outputs().size() != 1)
    throw UsageError("the net '", net.name(), "' has ", plan.outputs().size(),
                     " outputs; select the feature's layer with end");
  FeatureExtractor extractor;
  extractor.name = plan.outputs()[0].name;
  extractor.dim = plan.outputs()[0].shape.elements();
  extractor.key = str(net_key, "\nlayer ", extractor.name, "\nmean_bgr ", exact(mean_bgr[0]), " ",
                      exact(mean_bgr[1]), " ", exact(mean_bgr[2]), " scale ", exact(input_scale),
                      "\n", geometry_key(geometry), precision_key(forward.precision));
  extractor.make = [images]() -> FeatureFunction<RangeImage> {
    auto run = std::make_shared<engine::Run>(images.plan);
    return [run, images](const RangeImage& image, std::span<float> feature) {
      images.fill(*run, image.pixels);
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

FeatureFunction<PointCloud> from_scan(const FeatureExtractor& extractor, AlignCase align,
                                      const ImageGeometry& geometry) {
  if (const auto* make = std::get_if<FeatureMaker<RangeImage>>(&extractor.make))
    return
        [of_image = (*make)(), align, geometry](const PointCloud& cloud, std::span<float> feature) {
          of_image(scan_to_image(cloud, align, geometry), feature);
        };
  if (const auto* make = std::get_if<FeatureMaker<PointCloud>>(&extractor.make)) {
    if (align == AlignCase::kNone) return (*make)();
    return [of_cloud = (*make)(), align](const PointCloud& cloud, std::span<float> feature) {
      of_cloud(rotated(cloud, principal_alignment(cloud, align).R_aligned_sensor), feature);
    };
  }
  throw UsageError("the feature ", extractor.name, " is of camera images, not of scans");
}

RangeImage scan_to_image(const PointCloud& cloud, AlignCase mode, const ImageGeometry& geometry) {
  Eigen::Matrix3f R_image_sensor = Eigen::Matrix3f::Identity();
  if (mode != AlignCase::kNone) R_image_sensor = principal_alignment(cloud, mode).R_aligned_sensor;
  RangeImage image;
  project_rotated(cloud, R_image_sensor, geometry, image);
  return close_holes(std::move(image), geometry);
}

}  // namespace revisit
