#pragma once

#include <filesystem>
#include <vector>

#include "revisit/datasets/dataset.h"
#include "revisit/datasets/observer.h"
#include "revisit/recognition/ring/learn.h"

namespace revisit::pipeline {

/// What tells which scans are of one place, and how they are turned to each other.
enum class RingLesson {
  kLoops,     // poses: all pairs of scans that are near, also from one pass to another
  kOdometry,  // poses, which may drift: scans near in space and in time
  kSequence,  // each scan and the next, turned as their own rings say
  kScans,     // nothing: the scans alone
};

struct LearnRingOptions {
  RingLesson lesson = RingLesson::kLoops;
  double radius = 5;       // [m]: nearer scans are of one place
  int frames_apart = 50;   // kOdometry: scans farther apart in frames are not compared
  int column_scans = 200;  // the columns' directions are learnt from at most this many
  /// Altered copies of every scan to learn from: what random_alteration() changes tells no place.
  int altered = 2;
  int threads = 1;
  std::filesystem::path cache;  // folder of the rings
};

/// Learns a ring model from drives of one sensor. `model` holds the image, net and heights; the
/// rest is filled. Throws UsageError for a lesson that needs poses the data set has not, or finds
/// no pairs; what learn_columns(), learn_rings() and DatasetFeatures throw.
void learn_ring_model(RingModel& model, const engine::Net& net, const RingRecipe& recipe,
                      const std::vector<Dataset>& drives, const LearnRingOptions& options,
                      const Observer& observer);

/// Pairs of `scans` (rows, ascending) nearer than `radius` [m] on the ground, `frames_apart` frames
/// apart at most, and how they are turned; headings are along z of KITTI's T_world_cam.
std::vector<RingPair> pairs_nearby(const Dataset& dataset, const std::vector<int64_t>& scans,
                                   double radius, int frames_apart);

}  // namespace revisit::pipeline
