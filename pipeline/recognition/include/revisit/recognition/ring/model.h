#pragma once

#include <Eigen/Core>
#include <array>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "revisit/engine/net.h"
#include "revisit/recognition/calibration.h"
#include "revisit/recognition/matrix.h"
#include "revisit/recognition/point_cloud.h"
#include "revisit/recognition/range_image.h"

namespace revisit {

/// Ring descriptor, "ring" for short: a feature vector per azimuth sector, `[features][sectors]`
/// floats; azimuth decreases with the sector index, as in a range image
/// (docs/reference/METHODS.md). It is neither a laser channel nor a radial bin. A scan has two:
/// - the CNN ring (`cnn`): projected columns of a network's feature maps;
/// - the polar ring (`polar`): heights of points on a polar grid.
/// Each ring has weights `[weights][sectors]` in 0 to 1, the fraction of a bin that was seen;
/// feature i has the weights of index i % weights. The feature of a scan is the CNN ring, the polar
/// ring, the weights of the CNN ring and the weights of the polar ring, in this order.
/// ring_projection() projects it to the scan's descriptor.
///
/// A layer of the net, and the projection of its columns.
struct RingLayer {
  std::string name;         ///< in the prototxt
  std::vector<float> mean;  ///< [D], D = channels * rows of the map
  FloatMatrix directions;   ///< [d][D], orthonormal rows, largest variance first
};

/// Grid of the polar ring. Features: each bin's highest point [m], then a 0/1 flag for each band
/// that has points.
struct RingGrid {
  int sectors = 120;  ///< azimuth sectors
  /// Borders of the radial bins [m], ascending. Points beyond the last are ignored.
  std::vector<double> distances = {0,  2,  4,  6,  8,  10, 12, 14, 16, 18, 20,
                                   24, 28, 32, 36, 40, 48, 56, 64, 72, 80};
  std::vector<double> bands = {0.3, 1, 2, 3.5,
                               6};  ///< lower borders [m], ascending; the last is open
  /// Radial bins.
  int bins() const { return static_cast<int>(distances.size()) - 1; }
  /// Features per sector.
  int features() const { return bins() * (1 + static_cast<int>(bands.size())); }
};

/// Estimated statistics of one ring (docs/reference/METHODS.md, eq. 1 to 3). X_f, 0 <= f <
/// frequencies, is the Fourier coefficient of the ring for f periods per revolution: `features`
/// complex values.
struct RingStatistics {
  int sectors = 0, features = 0, weights = 1;  ///< sizes of the ring
  /// True: every scan is also used mirrored (left and right swapped), so the matrices are real.
  bool mirrored = false;
  std::vector<float> mean;  ///< [features][sectors], weighted mean over the training scans
  /// [f] T_f = E[X_f X_f^H] over scans, of the weighted difference from the mean
  std::vector<Eigen::MatrixXcd> total;
  /// [f] B_f, which pairs of scans of one place share, rotated to one yaw; empty without pairs
  std::vector<Eigen::MatrixXcd> shared;
  int64_t size() const { return int64_t{sectors} * features; }         ///< floats of the ring
  int64_t weights_size() const { return int64_t{sectors} * weights; }  ///< floats of its weights
};

/// Net, grid and statistics of the ring descriptors of one sensor.
struct RingModel {
  std::string sensor;                ///< human-readable
  double sensor_height = 1.73;       ///< [m] above ground, after gravity alignment
  ImageGeometry image;               ///< geometry for gravity-aligned scans
  std::string prototxt;              ///< text of a Caffe net
  std::string weights;               ///< bytes of its caffemodel; "" if too large to ship
  std::string weights_sha1;          ///< of the caffemodel, lower-case hexadecimal
  std::array<double, 3> mean_bgr{};  ///< as network_features() takes it
  std::vector<RingLayer> layers;     ///< their projected columns are concatenated
  RingGrid grid;                     ///< of the polar ring
  double cnn_weight = 0.3;           ///< fraction of a descriptor's squared length; rest: polar
  RingStatistics cnn, polar;         ///< of the ring of this name
  std::string trained_on;            ///< human-readable
  int64_t scans = 0;                 ///< number of training scans
  /// Holds for ring_recognizer() with default options.
  std::optional<Calibration> calibration;
  /// Floats of a scan's feature.
  int64_t dim() const {
    return cnn.size() + polar.size() + cnn.weights_size() + polar.weights_size();
  }
};

/// Write and read a model (docs/reference/FORMATS.md). Throw InputError with the file and the
/// defect: kind, checksum, version, sizes that do not match, or values that are not finite. Throw
/// Error if a write fails.
void write_ring_model(const std::filesystem::path& file, const RingModel& model);
RingModel read_ring_model(const std::filesystem::path& file);  ///< inverse of write_ring_model()
/// `name` is for messages.
std::string ring_model_content(const RingModel& model);
RingModel parse_ring_model(std::string_view content, const std::string& name);  ///< throws likewise

/// Names and models shipped with the library, trained on simulated towns by
/// tools/train_ring_models.sh. The names are those of sensor_geometry(). By default the network is
/// one convolution with random weights. Given the SHA-1 of SqueezeNet v1.0's weights, it is
/// SqueezeNet; the caller must then pass the weights to ring_net(). Throws UsageError for another
/// sensor or other weights.
std::vector<std::string> shipped_ring_models();
/// The model for a sensor; see shipped_ring_models().
RingModel shipped_ring_model(const std::string& sensor, const std::string& weights_sha1 = "");
/// Sensor whose shipped model has this FeatureExtractor::key; "" if none has.
std::string shipped_ring_sensor(const std::string& key);

/// Chooses the shipped ring model for scans of one sensor, in this order:
/// - the model that a map was built with, if it is a shipped one (`made_by`, the
///   FeatureExtractor::key in the map's configuration fingerprint);
/// - the sensor's own model, if beams or field of view identify the sensor;
/// - the nearest model. Candidates hold at least 88 % of the non-ground points that the best one
///   holds. Among them it has the smallest difference in upper edge and number of beams (if beams
///   can be separated).
/// Tilt and mounting height do not matter, because scans are gravity-aligned. Only models with
/// `weights_sha1` are candidates, as in shipped_ring_model(). Returns the sensor and a
/// human-readable reason. Throws UsageError without points.
std::pair<std::string, std::string> choose_ring_model(const std::vector<PointCloud>& scans,
                                                      const std::string& made_by = "",
                                                      const std::string& weights_sha1 = "");

/// Layers of the net, and the dimensions that are kept of their columns.
using LayerDimensions = std::vector<std::pair<std::string, int>>;

/// Writes the next training scan; returns false after the last one.
using NextScan = std::function<bool(PointCloud&)>;

/// Fills `model.layers` and the sizes of the rings with the principal directions of feature map
/// columns; uses the model's image, net and heights. Throws what ring_features() throws, and
/// UsageError without layers or for more dimensions than the columns have.
void train_cnn_ring(RingModel& model, const engine::Net& net, const LayerDimensions& layers,
                    int sectors, const NextScan& next);

/// Two scans of one place, as rows.
struct RingPair {
  int64_t a = 0, b = 0;     ///< rows
  double relative_yaw = 0;  ///< yaw(b) - yaw(a), counter-clockwise [rad]
};

/// Training data of one drive.
struct RingDrive {
  Rows rings;                   ///< [n][RingModel::dim()], from ring_features()
  std::vector<int64_t> scans;   ///< training rows, ascending
  std::vector<RingPair> pairs;  ///< of training rows
  /// Augmented copies of `rings`, row for row; differences between them get no weight in `shared`.
  std::vector<Rows> augmented = {};
};

/// Fills mean, total and shared of both rings. The mean of each drive's unaugmented scans is
/// subtracted from its rings. Without pairs `shared` stays empty. Throws UsageError without drives
/// or for a drive of fewer than 2 scans, InputError for rings of a wrong size.
void train_rings(RingModel& model, std::span<const RingDrive> drives);

/// Fits `model` to the map of these scans (rows of `rings`).
/// - Mean: replaced by the mean of the n scans, because the mean of another sensor or of simulated
///   scans hides what real scans of a place share. For n < 9 the weight of the new mean is (n - 1)
///   / 8.
/// - Total covariance: a fraction of it is replaced by the covariance of these scans. With d
///   features per sector, the fraction is blend * (n - d) / (n - d + 128), and 0 for n <= d.
/// Throws UsageError without scans or unless 0 <= blend <= 1.
void fit_to_map(RingModel& model, const Rows& rings, std::span<const int64_t> scans, double blend);

}  // namespace revisit
