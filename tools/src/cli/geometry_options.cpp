#include "cli/geometry_options.h"

#include <cmath>
#include <iostream>

#include "cli/table.h"
#include "revisit/base/text.h"

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
  Table table({"sensor", "", "beams", "from [deg]", "to [deg]", "image from", "to", "row [deg]",
               "closing [deg]"});
  for (const Sensor& sensor : sensors()) {
    const ImageGeometry& g = sensor.image;
    table.row({sensor.name, sensor.model, sensor.beams ? str(sensor.beams) : "none",
               degrees(sensor.top), degrees(sensor.bottom), degrees(g.elevation_top),
               degrees(g.elevation_bottom),
               degrees((g.elevation_top - g.elevation_bottom) / g.height),
               degrees(g.closing_width) + " x " + degrees(g.closing_height)});
  }
  table.print(std::cout);
}

struct Field {
  const char *name, *unit, *help;
  std::optional<double> GeometryOptions::*given;
  double ImageGeometry::*value;
};
constexpr Field kFields[] = {
    {"top", "DEG", "elevation of the upper edge (default: the sensor's)", &GeometryOptions::top,
     &ImageGeometry::elevation_top},
    {"bottom", "DEG", "elevation of the lower edge (default: the sensor's)",
     &GeometryOptions::bottom, &ImageGeometry::elevation_bottom},
    {"max-range", "METERS", "range of pixel value 255 (default 80)", &GeometryOptions::max_range,
     &ImageGeometry::max_range},
    {"closing-width", "DEG",
     "width of the rectangle that closes holes; 0: none (default: the sensor's)",
     &GeometryOptions::closing_width, &ImageGeometry::closing_width},
    {"closing-height", "DEG", "height of that rectangle (default: the sensor's)",
     &GeometryOptions::closing_height, &ImageGeometry::closing_height}};

}  // namespace

void GeometryOptions::declare(Options& options) {
  options.group("Range image:")
      .option("sensor", "NAME|list",
              "sensor that sets the image and the ring model; list: known sensors (default auto: "
              "from the first scans)",
              &sensor)
      .suggest(sensor_names())
      .listed_by(print_sensors)
      .common()
      .option("width", "PIXELS", "columns of the range image (default 4000)", &width)
      .option("height", "PIXELS", "rows of the range image (default 112)", &height);
  for (const Field& field : kFields)
    options.option(field.name, field.unit, field.help, &(this->*field.given));
}

bool GeometryOptions::is_auto() const {
  return sensor == kAuto;
}

std::string GeometryOptions::resolve(const std::vector<PointCloud>& scans) {
  if (!is_auto()) return "";
  const SensorFound found = find_sensor(scans);
  const std::vector<double>& beams = found.beams.elevations;
  const std::string seen =
      beams.empty() ? str("no separate beams, 99 % of the points from ", signed_(found.beams.top),
                          " to ", signed_(found.beams.bottom), " degrees")
                    : str(beams.size(), " beams from ", signed_(beams.front()), " to ",
                          signed_(beams.back()), " degrees");
  if (!found.name.empty()) {
    sensor = found.name;
    return str(seen, ": ", found.name);
  }
  top = top.value_or(found.image.elevation_top);
  bottom = bottom.value_or(found.image.elevation_bottom);
  closing_width = closing_width.value_or(to_hundredths(found.image.closing_width));
  closing_height = closing_height.value_or(to_hundredths(found.image.closing_height));
  return str(seen, ": not a known sensor, so --top ", exact(*top), " --bottom ", exact(*bottom),
             " --closing-width ", exact(*closing_width), " --closing-height ",
             exact(*closing_height));
}

ImageGeometry GeometryOptions::geometry() const {
  ImageGeometry geometry = sensor == kAuto ? ImageGeometry() : sensor_geometry(sensor);
  geometry.width = width.value_or(geometry.width);
  geometry.height = height.value_or(geometry.height);
  for (const Field& field : kFields)
    geometry.*field.value = (this->*field.given).value_or(geometry.*field.value);
  check_geometry(geometry);
  return geometry;
}

}  // namespace revisit::cli
