#pragma once

#include <Eigen/Core>
#include <array>
#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "revisit/recognition/calibration.h"
#include "revisit/recognition/matrix.h"
#include "revisit/recognition/polar_heights.h"
#include "revisit/recognition/range_image.h"

namespace revisit::pipeline {

/// Rings (docs/METHODS.md): what a scan looks like in every direction. A ring is
/// `[numbers][sectors]` floats; azimuth falls with the sector, as with the columns of a range
/// image. A scan has two, one behind the other in its feature: that of the network's columns and
/// that of heights.

/// The columns of one layer's feature map and the directions they are reduced to.
struct LayerColumns {
  std::string layer;
  std::vector<float> mean;  // [D], D = channels * rows of the map
  FloatMatrix directions;   // [d][D], orthonormal rows, largest variance first
};

/// What was learnt about one of a scan's rings. Frequency f counts periods around the ring,
/// 0 <= f < frequencies; X_f is the ring's Fourier coefficient, a vector of `numbers` complex.
struct RingStatistics {
  int sectors = 0, numbers = 0;
  std::vector<float> mean;              // [numbers][sectors], over the scans learnt from
  std::vector<Eigen::MatrixXcd> total;  // [f] E[X_f X_f^H] over scans, less their mean
  /// [f] E[X_f(a) X_f(b)^H] over pairs of scans of one place, b turned to a's heading; empty when
  /// it was learnt from scans alone.
  std::vector<Eigen::MatrixXcd> shared;
  int64_t size() const { return int64_t{sectors} * numbers; }
};

/// All it takes to turn scans of one sensor into rings and these into descriptors, but for the
/// network's weights when they are large.
struct RingModel {
  std::string sensor;                // for people: what it was learnt for
  ImageGeometry image;               // the sensor frame's, not aligned
  std::string prototxt;              // the text of a Caffe net
  std::string weights;               // the bytes of its caffemodel; "" when they are too large
  std::string weights_sha1;          // of the caffemodel
  std::array<double, 3> mean_bgr{};  // as network_features() takes it
  std::vector<LayerColumns> layers;  // the net's; their reduced columns stand one below the other
  PolarGrid heights;
  RingStatistics columns, polar;
  std::string learnt_from;  // for people
  int64_t scans = 0;        // that the rings were learnt from
  /// Of matches of ring_recogniser()'s descriptors with its default options.
  std::optional<Calibration> calibration;
  /// Floats of a scan's feature: both rings.
  int64_t dim() const { return columns.size() + polar.size(); }
};

/// Writes and reads a model (docs/FORMATS.md). Throw InputError naming the file and what is wrong:
/// not a model, a damaged one (it carries a checksum), one of a later version, numbers that do not
/// fit together or are not finite; Error when it cannot be written.
void write_ring_model(const std::filesystem::path& file, const RingModel& model);
RingModel read_ring_model(const std::filesystem::path& file);
/// The same of a file's content; `name` is for messages.
std::string ring_model_content(const RingModel& model);
RingModel parse_ring_model(std::string_view content, const std::string& name);

/// The models that come with the library, learnt from simulated towns by
/// tools/learn_ring_models.sh: the sensors' names as sensor_geometry() takes them. Their network is
/// one convolution with random weights; with the SHA-1 of SqueezeNet v1.0's weights, which
/// ring_net() is then to be given, it is that. Throws UsageError for another sensor and for others.
std::vector<std::string> shipped_ring_models();
RingModel shipped_ring_model(const std::string& sensor, const std::string& weights_sha1 = "");

}  // namespace revisit::pipeline
