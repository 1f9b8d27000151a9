#include "cli/geometry_options.h"

#include <cmath>
#include <iostream>

#include "cli/terminal.h"
#include "revisit/base/text.h"
#include "revisit/recognition/ring/model.h"

namespace revisit::cli {
namespace {

constexpr const char* kAuto = "auto";

std::string degrees(double value) {
  return number(value, 2);
}

std::string signed_(double degrees) {
  return (degrees > 0 ? "+" : "") + number(degrees, 1);
}

double to_hundredths(double degrees) {
  return std::round(100 * degrees) / 100;
}

void print_sensors() {
  const std::vector<std::string> models = shipped_ring_models();
  Table table({"sensor", "", "ring model", "beams", "from [deg]", "to [deg]", "image from", "to",
               "row [deg]", "closing [deg]"});
  for (const Sensor& sensor : sensors()) {
    const ImageGeometry& g = sensor.image;
    table.row({sensor.name, sensor.model,
               std::ranges::count(models, sensor.name) > 0 ? sensor.name : "nearest",
               sensor.beams ? str(sensor.beams) : "none", degrees(sensor.top),
               degrees(sensor.bottom), degrees(g.elevation_top), degrees(g.elevation_bottom),
               degrees((g.elevation_top - g.elevation_bottom) / g.height),
               degrees(g.closing_width) + " x " + degrees(g.closing_height)});
  }
  table.print(std::cout);
}

struct Field {
  const char* key;
  double ImageGeometry::*value;
};
constexpr Field kFields[] = {{"top", &ImageGeometry::elevation_top},
                             {"bottom", &ImageGeometry::elevation_bottom},
                             {"max-range", &ImageGeometry::max_range},
                             {"closing-width", &ImageGeometry::closing_width},
                             {"closing-height", &ImageGeometry::closing_height}};

int pixels(const std::map<std::string, double>& given, const char* key, int otherwise) {
  const auto found = given.find(key);
  if (found == given.end()) return otherwise;
  const double value = found->second;
  if (value != std::floor(value) || std::abs(value) > 1e6)
    throw UsageError("--geometry ", key, ": expected a number of pixels, found ", exact(value));
  return static_cast<int>(value);
}

}  // namespace

void GeometryOptions::declare(Options& options) {
  std::vector<std::string> keys = {"width", "height"};
  for (const Field& field : kFields) keys.emplace_back(field.key);
  options.group("Range image:")
      .option("sensor", "NAME|list",
              "sensor that sets the image and the ring model; list: known sensors (default auto: "
              "from the first scans)",
              &sensor)
      .suggest(sensor_names())
      .listed_by(print_sensors)
      .common()
      .option("geometry",
              "of the range image: width=4000 and height=112 [pixels], top and bottom [deg] of its "
              "edges, max-range=80 [m] of pixel value 255, closing-width and closing-height [deg] "
              "of the rectangle that closes holes, 0 for none (default: the sensor's)",
              keys, &given);
}

bool GeometryOptions::is_auto() const {
  return sensor == kAuto;
}

std::string GeometryOptions::resolve(const std::vector<PointCloud>& scans) {
  if (!is_auto()) return "";
  const SensorFound found = find_sensor(scans);
  const std::vector<double>& beams = found.elevations;
  const std::string seen = beams.empty()
                               ? str("no separate beams, 99 % of the points from ",
                                     signed_(found.top), " to ", signed_(found.bottom), " degrees")
                               : str(beams.size(), " beams from ", signed_(beams.front()), " to ",
                                     signed_(beams.back()), " degrees");
  if (!found.name.empty()) {
    sensor = found.name;
    return str(seen, ": ", found.name);
  }
  given.try_emplace("top", found.image.elevation_top);
  given.try_emplace("bottom", found.image.elevation_bottom);
  given.try_emplace("closing-width", to_hundredths(found.image.closing_width));
  given.try_emplace("closing-height", to_hundredths(found.image.closing_height));
  return str(seen, ": not a known sensor, so --geometry ", joined(given, ",", [](const auto& one) {
               return one.first + "=" + exact(one.second);
             }));
}

ImageGeometry GeometryOptions::geometry() const {
  ImageGeometry geometry = sensor == kAuto ? ImageGeometry() : sensor_geometry(sensor);
  geometry.width = pixels(given, "width", geometry.width);
  geometry.height = pixels(given, "height", geometry.height);
  for (const Field& field : kFields)
    if (const auto found = given.find(field.key); found != given.end())
      geometry.*field.value = found->second;
  check_geometry(geometry);
  return geometry;
}

}  // namespace revisit::cli
