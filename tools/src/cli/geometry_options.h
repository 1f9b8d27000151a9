#pragma once

#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "cli/parser.h"
#include "revisit/recognition/sensor.h"

namespace revisit::cli {

/// Options of the range image.
struct GeometryOptions {
  std::string sensor = "auto";                          // or a name of pipeline::sensors()
  std::optional<int> width, height;                     // [pixels]
  std::optional<double> top, bottom, max_range;         // [deg], [deg], [m]
  std::optional<double> closing_width, closing_height;  // [deg]

  void declare(Parser& parser);
  /// True if the sensor is to be detected from the scans.
  bool is_auto() const;
  /// Replaces `auto` by the sensor of the scans, or sets edges and closing rectangle that were not
  /// given. Returns the result for people, "" if a sensor was given.
  std::string resolve(const std::vector<pipeline::PointCloud>& scans);
  /// Geometry of the sensor (`auto`: the default) with the given values. Throws UsageError if it is
  /// invalid.
  pipeline::ImageGeometry geometry() const;
  /// Every option with its value, "" if it has none.
  std::vector<std::pair<std::string, std::string>> settings() const;
};

/// True if the arguments have `--sensor list`; prints the sensors then.
bool lists_sensors(const Arguments& arguments);

}  // namespace revisit::cli
