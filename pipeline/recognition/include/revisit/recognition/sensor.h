#pragma once

#include <string>
#include <vector>

#include "revisit/recognition/range_image.h"

namespace revisit::pipeline {

/// A sensor on the market and the image its scans are projected to: 4000 x 112 for all of them, so
/// that every network gives one feature size. docs/FORMATS.md has the table and its sources.
struct Sensor {
  std::string name;            // what sensor_geometry() takes: "ouster-os1-128"
  std::string model;           // what is printed on it: "Ouster OS1-128"
  int beams = 0;               // 0: it does not scan in fixed beams
  double top = 0, bottom = 0;  // elevations of the outermost beams, or of the field of view [deg]
  ImageGeometry image;
};
/// All known sensors: no beam lies on an image's edge; closing bridges most neighbouring beams.
const std::vector<Sensor>& sensors();

/// The image of a sensor. Throws UsageError naming the nearest sensor.
ImageGeometry sensor_geometry(const std::string& sensor);
std::vector<std::string> sensor_names();

/// What the elevations of scans' points say of the sensor.
struct Beams {
  std::vector<double> elevations;  // [deg], top first; empty: they cannot be told apart
  double top = 0, bottom = 0;      // [deg], 99 % of the returns are between
};

/// The sensor that scans look like they were taken by, and an image for them.
struct SensorFound {
  std::string name;  // of sensors(); "": unknown, then the image is made for what was found
  ImageGeometry image;
  Beams beams;
  double inside = 0;  // share of the returns that the image holds
};

/// Tells beams of one sensor apart by elevation or, if smeared, by the order of points as in KITTI.
Beams find_beams(const std::vector<PointCloud>& scans);

/// The sensor of the beams that find_beams() tells apart, or an image made for them.
SensorFound find_sensor(const std::vector<PointCloud>& scans);

}  // namespace revisit::pipeline
