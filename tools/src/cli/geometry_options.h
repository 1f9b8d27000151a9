#pragma once

#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "cli/parser.h"
#include "revisit/recognition/sensor.h"

namespace revisit::cli {

/// The options of the range image, the same in every command that makes one.
struct GeometryOptions {
  std::string sensor = "auto";                          // or a name of pipeline::sensors()
  std::optional<int> width, height;                     // [pixels]
  std::optional<double> top, bottom, max_range;         // [deg], [deg], [m]
  std::optional<double> closing_width, closing_height;  // [deg]

  void declare(Parser& parser);
  /// Whether the scans are to say which sensor it is.
  bool is_auto() const;
  /// Replaces `auto` by the sensor that the scans show, or edges and a closing rectangle where not
  /// given. Returns what was found, for people; "" when a sensor was given.
  std::string resolve(const std::vector<pipeline::PointCloud>& scans);
  /// The sensor's (`auto`: the default), but for what is given. Throws UsageError if invalid.
  pipeline::ImageGeometry geometry() const;
  /// Every option with the value it has, "" where it has none.
  std::vector<std::pair<std::string, std::string>> settings() const;
};

/// Whether the arguments say `--sensor list`; the sensors are then printed.
bool lists_sensors(const Arguments& arguments);

}  // namespace revisit::cli
