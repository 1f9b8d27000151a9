#include "revisit/datasets/train_ring.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <deque>
#include <limits>

#include "revisit/base/hash.h"
#include "revisit/datasets/describe.h"
#include "revisit/datasets/perturbation.h"
#include "revisit/datasets/scan_file.h"
#include "revisit/recognition/ring/descriptor.h"

namespace revisit {
namespace {

/// In a world with z up, of a body with x forward, y left, z up.
Pose upright_pose(const Pose& pose, bool camera_axes) {
  return camera_axes ? axes_of_camera().inverse() * pose * axes_of_camera() : pose;
}

uint64_t number_of(const PointCloud& cloud) {
  uint64_t hash = kFnv1aStart;
  for (const Point& point : cloud.points)
    for (const float value : {point.x, point.y, point.z})
      hash = fnv1a(hash, std::bit_cast<uint32_t>(value));
  return hash;
}

void perturb_at_random(PointCloud& cloud, uint32_t which) {
  const uint64_t seed = fnv1a(number_of(cloud), which);
  perturb(cloud, random_augmentation(seed), seed);
}

FeatureExtractor of_perturbed_scans(const FeatureExtractor& extractor, int which) {
  FeatureExtractor perturbed = extractor;
  perturbed.key = str(extractor.key, " perturbed ", kPerturbationVersion, " ", which);
  perturbed.make = [make = std::get<FeatureMaker<PointCloud>>(extractor.make),
                    which]() -> FeatureFunction<PointCloud> {
    return [describe = make(), which, changed = PointCloud()](const PointCloud& cloud,
                                                              std::span<float> feature) mutable {
      changed = cloud;
      perturb_at_random(changed, static_cast<uint32_t>(which));
      describe(changed, feature);
    };
  };
  return perturbed;
}

/// Samples scans evenly over the drives; unreadable scans are skipped.
void train_cnn_ring_of(RingModel& model, const engine::Net& net, const LayerDimensions& layers,
                       const std::vector<Dataset>& drives, const TrainRingOptions& options,
                       const Observer& observer) {
  std::vector<const ScanRef*> all;
  for (const Dataset& drive : drives)
    for (const ScanRef& scan : drive.scans) all.push_back(&scan);
  const size_t count = std::min(all.size(), static_cast<size_t>(options.cnn_scans));
  const Progress progress = observer.stage("training CNN ring", "scans");
  size_t taken = 0;
  train_cnn_ring(model, net, layers, options.sectors, [&](PointCloud& cloud) {
    while (taken < count) {
      if (observer.stop && observer.stop()) throw Interrupted("training stopped");
      const ScanRef& scan = *all[taken++ * all.size() / count];
      progress(static_cast<int64_t>(taken), static_cast<int64_t>(count));
      try {
        read_scan_into(scan, cloud);
        if (options.augmentations > 0) perturb_at_random(cloud, 0);
        return true;
      } catch (const InputError&) {  // reported when it is described
      }
    }
    return false;
  });
}

std::vector<RingPair> neighbors(RingModel alone, const Rows& rings,
                                const std::vector<int64_t>& scans) {
  fit_to_map(alone, rings, scans, 0);
  const Projection projection = ring_projection(alone);
  std::vector<float> last(static_cast<size_t>(projection.dim)), next = last;
  std::vector<RingPair> pairs;
  for (size_t i = 0; i < scans.size(); ++i) {
    projection.describe(rings.row(scans[i]), next);
    if (i > 0)
      pairs.push_back({scans[i - 1], scans[i], projection.comparison.relative_yaw(last, next)});
    std::swap(last, next);
  }
  return pairs;
}

std::vector<RingPair> pairs_for(const TrainRingOptions& options, const Dataset& dataset,
                                const RingModel& alone, const Rows& rings,
                                const std::vector<int64_t>& scans) {
  switch (options.supervision) {
    case RingSupervision::kLoops:
      return find_near_pairs(dataset, scans, options.radius, std::numeric_limits<int>::max());
    case RingSupervision::kOdometry:
      return find_near_pairs(dataset, scans, options.radius, options.frames_apart);
    case RingSupervision::kSequence:
      return neighbors(alone, rings, scans);
    case RingSupervision::kScans:
      break;
  }
  return {};
}

}  // namespace

std::vector<RingPair> find_near_pairs(const Dataset& dataset, const std::vector<int64_t>& scans,
                                      double radius, int frames_apart) {
  std::vector<RingPair> pairs;
  const auto heading_of = [](const Pose& up) { return std::atan2(up(1, 0), up(0, 0)); };
  const auto scan_of = [&](int64_t row) -> const ScanRef& {
    return dataset.scans[static_cast<size_t>(row)];
  };
  for (size_t i = 0; i < scans.size(); ++i)
    for (size_t j = i + 1; j < scans.size(); ++j) {
      const ScanRef &a = scan_of(scans[i]), &b = scan_of(scans[j]);
      if (b.frame - a.frame > frames_apart) break;
      const Pose from = upright_pose(*a.pose, dataset.camera_axes);
      const Pose to = upright_pose(*b.pose, dataset.camera_axes);
      if ((to.translation() - from.translation()).head<2>().norm() >= radius) continue;
      pairs.push_back({scans[i], scans[j], heading_of(to) - heading_of(from)});
    }
  return pairs;
}

void train_ring_model(RingModel& model, const engine::Net& net, const LayerDimensions& layers,
                      const std::vector<Dataset>& drives, const TrainRingOptions& options,
                      const Observer& observer) {
  const bool by_poses = options.supervision == RingSupervision::kLoops ||
                        options.supervision == RingSupervision::kOdometry;
  for (const Dataset& drive : drives)
    if (by_poses && !drive.has_poses())
      throw UsageError("training from loops or odometry needs poses, which ", drive.name,
                       " lacks: use sequence or scans");
  train_cnn_ring_of(model, net, layers, drives, options, observer);
  const FeatureExtractor extractor = ring_features(model, net);
  std::vector<FeatureExtractor> perturbed;
  for (int i = 1; i <= options.augmentations; ++i)
    perturbed.push_back(of_perturbed_scans(extractor, i));
  const DescribeOptions how{.align = AlignCase::kNone, .threads = options.threads};
  std::deque<DatasetFeatures> features;
  std::vector<RingDrive> ring_drives;
  for (const Dataset& drive : drives) {
    DatasetFeatures& of_drive =
        features.emplace_back(drive, extractor, how, options.cache, observer);
    RingDrive& ring_drive = ring_drives.emplace_back();
    ring_drive.rings = of_drive.file().rows();
    std::vector<int64_t> skipped = of_drive.skipped();
    for (const FeatureExtractor& another : perturbed) {
      DatasetFeatures& again = features.emplace_back(drive, another, how, options.cache, observer);
      ring_drive.augmented.push_back(again.file().rows());
      const std::vector<int64_t> more = again.skipped();
      skipped.insert(skipped.end(), more.begin(), more.end());
    }
    std::ranges::sort(skipped);
    for (int64_t row = 0; row < ring_drive.rings.n; ++row)
      if (!std::ranges::binary_search(skipped, row)) ring_drive.scans.push_back(row);
  }
  train_rings(model, ring_drives);  // without pairs
  if (options.supervision == RingSupervision::kScans) return;
  size_t pairs = 0;
  for (size_t i = 0; i < drives.size(); ++i) {
    ring_drives[i].pairs =
        pairs_for(options, drives[i], model, ring_drives[i].rings, ring_drives[i].scans);
    pairs += ring_drives[i].pairs.size();
  }
  // One pair cannot discriminate directions.
  if (pairs < 2)
    throw UsageError("training rings: ", pairs, " pairs of scans are nearer than ", options.radius,
                     " m; at least 2 are required");
  observer.note(str("trained on ", pairs, " pairs of scans"));
  train_rings(model, ring_drives);
}

}  // namespace revisit
