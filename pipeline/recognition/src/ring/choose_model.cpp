#include "revisit/recognition/ring/choose_model.h"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "revisit/base/error.h"
#include "revisit/recognition/ground.h"
#include "revisit/recognition/ring/model.h"
#include "revisit/recognition/sensor.h"

namespace revisit {
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

RingModelChoice nearest(const std::vector<PointCloud>& scans) {
  constexpr double kEnough = 0.88;
  if (std::ranges::all_of(scans, [](const PointCloud& scan) { return scan.points.empty(); }))
    throw UsageError("choosing a ring model: expected scans with points, found none");
  const SensorFound found = find_sensor(scans);
  const size_t beams = found.beams.elevations.size();
  const std::string seen =
      str(beams > 0 ? str(beams, " beams") : "no separate beams", ", ",
          std::lround(found.beams.bottom), " to ", std::lround(found.beams.top), " degrees");
  const std::vector<std::string> models = shipped_ring_models();
  if (std::ranges::count(models, found.name) > 0) return {found.name, seen};
  std::vector<Fit> fits;
  for (const std::string& sensor : models) fits.push_back(fit_of(sensor, scans, beams));
  const double most = std::ranges::max(fits, {}, &Fit::held).held;
  std::erase_if(fits, [&](const Fit& fit) { return fit.held < kEnough * most; });
  const Fit best = std::ranges::min(fits, {}, &Fit::difference);
  return {best.sensor, str(seen, found.name.empty() ? "" : str(", like ", found.name),
                           "; no model for this sensor, the nearest covers ",
                           std::lround(100 * best.held), " % of the non-ground points")};
}

}  // namespace

RingModelChoice choose_ring_model(const std::vector<PointCloud>& scans,
                                  const std::string& made_by) {
  RingModelChoice choice = nearest(scans);
  const std::string of_map = shipped_ring_sensor(made_by);
  if (of_map.empty() || of_map == choice.sensor) return choice;
  return {of_map,
          str("of the map; the nearest to the scans is ", choice.sensor, ": ", choice.reason)};
}

}  // namespace revisit
