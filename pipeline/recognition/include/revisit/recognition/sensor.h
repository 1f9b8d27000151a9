#pragma once

#include <string>
#include <vector>

#include "revisit/recognition/range_image.h"

namespace revisit {

/// Image geometry is 4000 x 112 for all sensors, so that a network has one feature size.
/// docs/FORMATS.md has the table and its sources.
struct Sensor {
  std::string name;  // key of sensor_geometry(), e.g. "ouster-os1-128"
  std::string model;
  int beams = 0;               // 0: no fixed beams
  double top = 0, bottom = 0;  // elevations of the outermost beams, or of the field of view [deg]
  ImageGeometry image;
};
/// No beam lies on an image's edge; hole closing bridges most neighboring beams.
const std::vector<Sensor>& sensors();

/// Throws UsageError with the most similar name.
ImageGeometry sensor_geometry(const std::string& sensor);
std::vector<std::string> sensor_names();

struct Beams {
  std::vector<double> elevations;  // [deg], top first; empty: beams cannot be separated
  double top = 0, bottom = 0;      // [deg], limits of 99 % of the returns
};

struct SensorFound {
  std::string name;  // a name in sensors(); "": unknown, `image` then fits `beams`
  ImageGeometry image;
  Beams beams;
  double inside = 0;  // fraction of the returns inside the image
};

/// Separates beams by elevation or, if elevations are smeared, by point order as in KITTI.
Beams find_beams(const std::vector<PointCloud>& scans);

SensorFound find_sensor(const std::vector<PointCloud>& scans);

}  // namespace revisit
