#pragma once

#include <cstdint>
#include <functional>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "revisit/engine/net.h"
#include "revisit/recognition/matrix.h"
#include "revisit/recognition/point_cloud.h"
#include "revisit/recognition/ring/model.h"

namespace revisit {

struct RingRecipe {
  std::vector<std::pair<std::string, int>> layers;  // layer of the net, dimensions kept
  int sectors = 128;                                // CNN ring
};

/// Writes the next training scan; returns false after the last one.
using NextScan = std::function<bool(PointCloud&)>;

/// Fills `model.layers` and the sizes of the rings with the principal directions of feature map
/// columns; uses the model's image, net and heights. Throws what ring_features() throws, and
/// UsageError for a recipe without layers or with more dimensions than the columns have.
void train_columns(RingModel& model, const engine::Net& net, const RingRecipe& recipe,
                   const NextScan& next);

/// Two scans of one place, as rows.
struct RingPair {
  int64_t a = 0, b = 0;
  double relative_yaw = 0;  // yaw(b) - yaw(a), counter-clockwise [rad]
};

struct RingDrive {
  Rows rings;                  // [n][RingModel::dim()], from ring_features()
  std::vector<int64_t> scans;  // training rows, ascending
  std::vector<RingPair> pairs;
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
