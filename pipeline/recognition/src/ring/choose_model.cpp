#include <algorithm>
#include <cmath>
#include <cstddef>
#include <numbers>

#include "align/ground.h"
#include "revisit/base/error.h"
#include "revisit/base/text.h"
#include "revisit/recognition/range_image.h"
#include "revisit/recognition/ring/model.h"
#include "ring/extraction.h"

// embedded_models.cpp
extern "C" const char revisit_ring_hdl64[], revisit_ring_hdl64_end[], revisit_ring_vlp16[],
    revisit_ring_vlp16_end[], revisit_ring_ouster_os1_64[], revisit_ring_ouster_os1_64_end[],
    revisit_ring_livox_mid360[], revisit_ring_livox_mid360_end[], revisit_ring_hdl64_squeezenet[],
    revisit_ring_hdl64_squeezenet_end[], revisit_ring_vlp16_squeezenet[],
    revisit_ring_vlp16_squeezenet_end[], revisit_ring_ouster_os1_64_squeezenet[],
    revisit_ring_ouster_os1_64_squeezenet_end[];

namespace revisit {
namespace {

constexpr const char* kSqueezeNet = "0c5ba9eceae67db71dbfde095d807f4e1006c946";  // v1.0

struct Shipped {
  const char *sensor, *weights_sha1, *begin, *end;
};
const Shipped kShipped[] = {
    {"hdl64", "", revisit_ring_hdl64, revisit_ring_hdl64_end},
    {"vlp16", "", revisit_ring_vlp16, revisit_ring_vlp16_end},
    {"ouster-os1-64", "", revisit_ring_ouster_os1_64, revisit_ring_ouster_os1_64_end},
    {"livox-mid360", "", revisit_ring_livox_mid360, revisit_ring_livox_mid360_end},
    {"hdl64", kSqueezeNet, revisit_ring_hdl64_squeezenet, revisit_ring_hdl64_squeezenet_end},
    {"vlp16", kSqueezeNet, revisit_ring_vlp16_squeezenet, revisit_ring_vlp16_squeezenet_end},
    {"ouster-os1-64", kSqueezeNet, revisit_ring_ouster_os1_64_squeezenet,
     revisit_ring_ouster_os1_64_squeezenet_end},
};

std::vector<std::string> models_with(const std::string& weights_sha1) {
  std::vector<std::string> names;
  for (const Shipped& model : kShipped)
    if (model.weights_sha1 == weights_sha1) names.emplace_back(model.sensor);
  return names;
}

}  // namespace

std::vector<std::string> shipped_ring_models() {
  return models_with("");
}

std::string shipped_ring_sensor(const std::string& key) {
  for (const Shipped& model : kShipped)
    if (key.starts_with(extraction_key(shipped_ring_model(model.sensor, model.weights_sha1))))
      return model.sensor;
  return "";
}

RingModel shipped_ring_model(const std::string& sensor, const std::string& weights_sha1) {
  const auto* const found = std::ranges::find_if(kShipped, [&](const Shipped& model) {
    return model.sensor == sensor && model.weights_sha1 == weights_sha1;
  });
  if (found == std::end(kShipped))
    throw UsageError("no ring model for the sensor '", sensor, "'",
                     weights_sha1.empty() ? "" : " and these weights", "; there are models for ",
                     joined(shipped_ring_models(), ", "),
                     weights_sha1.empty()
                         ? ""
                         : str(", and with the weights of SqueezeNet v1.0 (SHA-1 ", kSqueezeNet,
                               ") for ", joined(models_with(kSqueezeNet), ", ")),
                     "; leave the sensor out to get the nearest model, or train one");
  return parse_ring_model({found->begin, static_cast<size_t>(found->end - found->begin)},
                          "the ring model of " + sensor);
}

namespace {

struct Fit {
  std::string sensor;
  double held = 0;        // fraction of the non-ground points that the image holds
  double difference = 0;  // difference in upper edge and beams
};

Fit fit_of(const std::string& sensor, const std::vector<PointCloud>& scans, size_t beams) {
  constexpr float kAboveGround = 0.5F;  // [m]
  constexpr double kEdge = 10;          // [deg], counts as much as a factor of 2 in beams
  const RingModel model = shipped_ring_model(sensor);
  std::vector<double> elevations;  // [deg]
  for (const PointCloud& scan : scans)
    for (const Point& p : level(scan, model.sensor_height).points)
      if (p.z > kAboveGround - model.sensor_height)
        elevations.push_back(std::atan2(p.z, std::hypot(p.x, p.y)) * 180 / std::numbers::pi);
  Fit fit{.sensor = sensor};
  if (elevations.empty()) return fit;
  const auto held = std::ranges::count_if(elevations, [&](double elevation) {
    return elevation < model.image.elevation_top && elevation > model.image.elevation_bottom;
  });
  fit.held = static_cast<double>(held) / static_cast<double>(elevations.size());
  const auto top = elevations.begin() + std::ssize(elevations) * 99 / 100;
  std::ranges::nth_element(elevations, top);
  fit.difference = std::abs(*top - model.image.elevation_top) / kEdge;
  if (beams > 0)
    fit.difference += std::abs(std::log2(static_cast<double>(beams) / model.image.height));
  return fit;
}

/// A model without beams is for scans without beams that show no more below, but for a tilt.
bool is_candidate(const std::string& sensor, const SensorFound& found) {
  constexpr double kTilt = 8;  // [deg]
  const auto known = std::ranges::find(sensors(), sensor, &Sensor::name);
  return known->beams > 0 || (found.elevations.empty() && found.bottom > known->bottom - kTilt);
}

std::pair<std::string, std::string> nearest(const std::vector<PointCloud>& scans,
                                            const std::string& weights_sha1) {
  constexpr double kEnough = 0.88;
  constexpr double kFew = 0.7;
  if (std::ranges::all_of(scans, [](const PointCloud& scan) { return scan.points.empty(); }))
    throw UsageError("choosing a ring model: expected scans with points, found none");
  const SensorFound found = find_sensor(scans);
  const size_t beams = found.elevations.size();
  const std::string seen =
      str(beams > 0 ? str(beams, " beams") : "no separate beams", ", ", std::lround(found.bottom),
          " to ", std::lround(found.top), " degrees");
  std::vector<std::string> models = models_with(weights_sha1);
  if (models.empty()) models = shipped_ring_models();  // shipped_ring_model() names the weights
  if (std::ranges::count(models, found.name) > 0) return {found.name, seen};
  std::vector<Fit> fits;
  for (const std::string& sensor : models)
    if (is_candidate(sensor, found)) fits.push_back(fit_of(sensor, scans, beams));
  const double most = std::ranges::max(fits, {}, &Fit::held).held;
  std::erase_if(fits, [&](const Fit& fit) { return fit.held < kEnough * most; });
  const Fit best = std::ranges::min(fits, {}, &Fit::difference);
  return {best.sensor,
          str(seen, found.name.empty() ? "" : str(", like ", found.name),
              "; no model for this sensor, the nearest covers ", std::lround(100 * best.held),
              " % of the non-ground points",
              best.held < kFew ? "; local maps (--local-map 10) find more places" : "")};
}

}  // namespace

std::pair<std::string, std::string> choose_ring_model(const std::vector<PointCloud>& scans,
                                                      const std::string& made_by,
                                                      const std::string& weights_sha1) {
  const std::string of_map = shipped_ring_sensor(made_by);
  if (scans.empty() && !of_map.empty()) return {of_map, "of the map"};
  auto [sensor, reason] = nearest(scans, weights_sha1);
  if (of_map.empty() || of_map == sensor) return {std::move(sensor), std::move(reason)};
  return {of_map, str("of the map; the nearest to the scans is ", sensor, ": ", reason)};
}

}  // namespace revisit
