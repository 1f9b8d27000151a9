#include "feature/image_plan.h"

#include <algorithm>

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

}  // namespace revisit
