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

namespace revisit::pipeline {

struct RingRecipe {
  std::vector<std::pair<std::string, int>> layers;  // of the net, and the numbers kept of each
  int sectors = 128;                                // of the network's ring
};

/// Gives the next scan to learn from; false when there is none left.
using NextScan = std::function<bool(PointCloud&)>;

/// Learns the principal directions of the columns of feature maps: fills `model.layers`, and the
/// sizes of its rings. Of `model` uses the image, net and heights. Throws what ring_features()
/// throws, UsageError for a recipe of no layers or more numbers than columns have.
void learn_columns(RingModel& model, const engine::Net& net, const RingRecipe& recipe,
                   const NextScan& next);

/// Two scans of one place.
struct RingPair {
  int64_t a = 0, b = 0;
  double turn = 0;  // heading of b less heading of a, counter-clockwise [rad]
};

struct RingDrive {
  Rows rings;                   // [n][RingModel::dim()], features of ring_features()
  std::vector<int64_t> scans;   // rows to learn from, ascending
  std::vector<RingPair> pairs;  // of them
  /// The same scans, row for row, altered: what differs then is left out of a place's share.
  std::vector<Rows> altered = {};
};

/// Learns what rings of one place share: fills mean, total and shared of both rings. Each drive's
/// rings are taken less the mean of those that are not altered. Without pairs `shared` stays empty.
/// Throws UsageError without drives and for one of fewer than 2 scans, InputError for rings of
/// another size.
void learn_rings(RingModel& model, std::span<const RingDrive> drives);

/// Makes `model` one for the map that these scans (rows of `rings`) are of: their mean becomes the
/// model's, as that of another sensor or of simulated scans hides what real places share (of n < 9
/// scans in part, (n - 1) / 8: the mean of one scan is that scan); and their
/// spread takes the place of the share `adapt` of the model's total spread. Of n scans more than a
/// ring has numbers it takes n / (n + 128) of that: fewer do not know their spread. Throws
/// UsageError without scans and for a share outside of 0 to 1.
void fit_to_map(RingModel& model, const Rows& rings, std::span<const int64_t> scans, double adapt);

}  // namespace revisit::pipeline
