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
#include "revisit/recognition/range_image.h"

namespace revisit::pipeline {

/// Rings (docs/METHODS.md): what a scan looks like in every direction. A ring is
/// `[numbers][sectors]` floats; azimuth falls with the sector, as with the columns of a range
/// image. A scan has two: that of the network's columns, and the polar ring, what stands on the
/// ground. Beside each stand its weights `[weights][sectors]`, 0 to 1: how much of it was seen;
/// number i has the weights i % weights. A feature is: columns, polar ring, weights of the columns,
/// weights of the polar ring.

/// The columns of one layer's feature map and the directions they are reduced to.
struct LayerColumns {
  std::string layer;
  std::vector<float> mean;  // [D], D = channels * rows of the map
  FloatMatrix directions;   // [d][D], orthonormal rows, largest variance first
};

/// The polar ring's grid. Numbers: each bin's highest point [m], then its bands that hold points.
struct RingGrid {
  int sectors = 120;
  /// Borders of the bins along the ground [m], ascending. What lies beyond the last is left out.
  std::vector<double> distances = {0,  2,  4,  6,  8,  10, 12, 14, 16, 18, 20,
                                   24, 28, 32, 36, 40, 48, 56, 64, 72, 80};
  std::vector<double> bands = {0.3, 1, 2, 3.5,
                               6};  // lower borders [m], ascending; the last is open
  int bins() const { return static_cast<int>(distances.size()) - 1; }
  int numbers() const { return bins() * (1 + static_cast<int>(bands.size())); }
};

/// What was learnt about one of a scan's rings. Frequency f counts periods around the ring,
/// 0 <= f < frequencies; X_f is the ring's Fourier coefficient, a vector of `numbers` complex.
struct RingStatistics {
  int sectors = 0, numbers = 0, weights = 1;
  /// Left and right count alike: places teach with their mirror images; the matrices are real.
  bool mirrored = false;
  std::vector<float> mean;  // [numbers][sectors], over the scans learnt from, each by its weights
  /// [f] E[X_f X_f^H] over scans, less the mean and times their weights
  std::vector<Eigen::MatrixXcd> total;
  /// [f] E[X_f(a) X_f(b)^H] over pairs of one place, b at a's heading; empty without pairs.
  std::vector<Eigen::MatrixXcd> shared;
  int64_t size() const { return int64_t{sectors} * numbers; }
  int64_t weights_size() const { return int64_t{sectors} * weights; }
};

/// All that turns one sensor's scans into descriptors, but for the weights of large networks.
struct RingModel {
  std::string sensor;                // for people: what it was learnt for
  double sensor_height = 1.73;       // [m]: scans are levelled, their ground so far below
  ImageGeometry image;               // of a levelled scan
  std::string prototxt;              // the text of a Caffe net
  std::string weights;               // the bytes of its caffemodel; "" when they are too large
  std::string weights_sha1;          // of the caffemodel
  std::array<double, 3> mean_bgr{};  // as network_features() takes it
  std::vector<LayerColumns> layers;  // the net's; their reduced columns stand one below the other
  RingGrid grid;
  double columns_share = 0.3;  // of a descriptor's squared length; the rest is the polar ring's
  RingStatistics columns, polar;
  std::string learnt_from;  // for people
  int64_t scans = 0;        // that the rings were learnt from
  /// Of matches of ring_recogniser()'s descriptors with its default options.
  std::optional<Calibration> calibration;
  /// Floats of a scan's feature: both rings and their weights.
  int64_t dim() const {
    return columns.size() + polar.size() + columns.weights_size() + polar.weights_size();
  }
};

/// Writes and reads a model (docs/FORMATS.md). Throw InputError naming the file and what is wrong
/// (kind, checksum, version, numbers that do not fit or are not finite); Error on a failed write.
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
/// The sensor whose shipped model makes features of this FeatureExtractor::key; "" when none does.
std::string shipped_ring_sensor(const std::string& key);

}  // namespace revisit::pipeline
