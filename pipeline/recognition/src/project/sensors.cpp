#include "revisit/base/error.h"
#include "revisit/base/text.h"
#include "revisit/recognition/sensor.h"

namespace revisit {
namespace {

struct Row {
  const char *name, *model;
  int beams;
  double top, bottom;                 // [deg], elevations of the outermost beams
  double image_top, image_bottom;     // [deg]
  int closing_width, closing_height;  // [pixels] of 4000 x 112
};
constexpr Row kSensors[] = {
    {"hdl64", "Velodyne HDL-64E", 64, 2, -24.8, 3, -25, 5, 3},
    {"hdl32", "Velodyne HDL-32E", 32, 10.67, -30.67, 34.0 / 3, -94.0 / 3, 5, 5},
    {"vlp16", "Velodyne VLP-16", 16, 15, -15, 16, -16, 5, 9},
    {"ouster-os0-32", "Ouster OS0-32", 32, 45, -45, 46.5, -46.5, 5, 5},
    {"ouster-os0-64", "Ouster OS0-64", 64, 45, -45, 46, -46, 5, 3},
    {"ouster-os0-128", "Ouster OS0-128", 128, 45, -45, 45.5, -45.5, 5, 3},
    {"ouster-os1-64", "Ouster OS1-64", 64, 22.5, -22.5, 23, -23, 5, 3},
    {"ouster-os1-64-gen1", "Ouster OS1-64, generation 1", 64, 16.6, -16.6, 17.5, -17.5, 5, 3},
    {"ouster-os1-128", "Ouster OS1-128", 128, 22.5, -22.5, 23, -23, 5, 3},
    {"ouster-os2-64", "Ouster OS2-64", 64, 11.25, -11.25, 11.5, -11.5, 5, 3},
    {"ouster-os2-128", "Ouster OS2-128", 128, 11.25, -11.25, 11.5, -11.5, 5, 3},
    {"pandar64", "Hesai Pandar64", 64, 15, -25, 15.5, -25.5, 5, 5},
    {"livox-mid360", "Livox Mid-360", 0, 52, -7, 52.5, -7.5, 15, 5},
};

ImageGeometry image_of(const Row& row) {
  ImageGeometry image;
  image.elevation_top = row.image_top;
  image.elevation_bottom = row.image_bottom;
  image.closing_width = row.closing_width * 360.0 / image.width;
  image.closing_height = row.closing_height * (row.image_top - row.image_bottom) / image.height;
  return image;
}

}  // namespace

const std::vector<Sensor>& sensors() {
  static const std::vector<Sensor> all = [] {
    std::vector<Sensor> made;
    for (const Row& row : kSensors)
      made.push_back({row.name, row.model, row.beams, row.top, row.bottom, image_of(row)});
    return made;
  }();
  return all;
}

ImageGeometry sensor_geometry(const std::string& sensor) {
  for (const Sensor& known : sensors())
    if (known.name == sensor) return known.image;
  throw UsageError("unknown sensor '", sensor, "'", nearest_name_hint(sensor, sensor_names()),
                   "; known: ", joined(sensor_names(), " "));
}

std::vector<std::string> sensor_names() {
  std::vector<std::string> names;
  for (const Sensor& sensor : sensors()) names.push_back(sensor.name);
  return names;
}

}  // namespace revisit
