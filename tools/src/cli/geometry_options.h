#pragma once

#include <map>
#include <string>
#include <vector>

#include "cli/options.h"
#include "revisit/recognition/range_image.h"

namespace revisit::cli {

struct GeometryOptions {
  std::string sensor = "auto";          // or a name of sensors()
  std::map<std::string, double> given;  // by key, see declare()

  void declare(Options& options);
  bool is_auto() const;
  /// Replaces `auto` by the sensor of the scans, or sets edges and closing rectangle that were not
  /// given. Returns a message, "" if a sensor was given.
  std::string resolve(const std::vector<PointCloud>& scans);
  /// Starts from the default geometry for `auto`. Throws UsageError if the result is invalid.
  ImageGeometry geometry() const;
};

}  // namespace revisit::cli
