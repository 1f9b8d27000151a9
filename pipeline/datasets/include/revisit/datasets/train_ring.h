#pragma once

#include <filesystem>
#include <vector>

#include "revisit/datasets/dataset.h"
#include "revisit/datasets/observer.h"
#include "revisit/recognition/ring/model.h"

namespace revisit {

/// Source of the pairs of scans that show one place.
enum class RingSupervision {
  kLoops,     ///< poses: all pairs of near scans, also of different passes
  kOdometry,  ///< poses with drift: scans near in space and in time
  kSequence,  ///< consecutive scans; their own rings determine the relative yaw
  kScans,     ///< no pairs, scans only
};

/// Settings of train_ring_model().
struct TrainRingOptions {
  RingSupervision supervision = RingSupervision::kLoops;  ///< source of the pairs
  double radius = 5;      ///< [m], maximum distance of two scans of one place
  int frames_apart = 50;  ///< kOdometry: maximum distance of a pair in frames
  int sectors = 128;      ///< of the CNN ring
  int cnn_scans = 200;    ///< maximum number of scans for the CNN ring's projection
  /// Number of augmented copies of every scan, by random_augmentation().
  int augmentations = 2;
  int threads = 1;              ///< does not affect the result
  std::filesystem::path cache;  ///< folder of the features
};

/// Trains a ring model on drives of one sensor. The caller sets image, net and heights of `model`;
/// the function fills the rest. Throws UsageError if the supervision needs poses that the data set
/// lacks, or yields no pairs; and what train_cnn_ring(), train_rings() and DatasetFeatures throw.
void train_ring_model(RingModel& model, const engine::Net& net, const LayerDimensions& layers,
                      const std::vector<Dataset>& drives, const TrainRingOptions& options,
                      const Observer& observer);

/// `scans` are rows, ascending. Pairs are at most `radius` [m] apart on the ground and at most
/// `frames_apart` frames.
std::vector<RingPair> find_near_pairs(const Dataset& dataset, const std::vector<int64_t>& scans,
                                      double radius, int frames_apart);

}  // namespace revisit
