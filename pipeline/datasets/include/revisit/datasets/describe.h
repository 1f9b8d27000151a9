#pragma once

#include <cstdint>
#include <filesystem>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "revisit/datasets/alteration.h"
#include "revisit/datasets/dataset.h"
#include "revisit/recognition/feature.h"

namespace revisit::pipeline {

/// A scan is altered in one way for one seed, whatever other scans there are.
struct AlteredScans {
  Alteration alteration;
  uint32_t seed = 0;
};

struct DescribeOptions {
  ImageGeometry geometry;
  AlignCase align = AlignCase::kOne;
  std::optional<AlteredScans> altered;
  /// Scans in flight, one thread each. The values do not depend on it.
  int threads = 1;
  /// Ends the work at a scan that cannot be described, instead of giving it a zero feature.
  bool strict = false;
  std::function<void(const ScanRef& scan, const std::string& why)> left_out;  // of each, in order
  std::function<void(const std::string& file)> damaged;       // a finished file that is made anew
  std::function<void(int64_t done, int64_t total)> progress;  // in scans
  std::function<bool()> stop;                                 // true: throw Interrupted
};

/// Milliseconds of one thread, by stage, for each scan described in this process; else empty.
struct DescribeTimes {
  std::vector<double> read, align, project, close, feature, write;
  double wall_ms = 0;  // of all of them, all threads together
  /// Processor time from points or image in memory to the feature; other work adds nothing to it.
  std::vector<double> processor;

  void append(const DescribeTimes& more);
};

/// 6 floats; NaN where unknown: for camera images, scans left out, clouds without a direction.
struct AlignmentRecord {
  float yaw = 0;               // [rad], Alignment::yaw
  float eigenvalue_ratio = 0;  // Alignment::eigenvalue_ratio
  float abs_t11 = 0;           // Alignment::abs_t11
  float mirrored_choice = 0;   // 0 or 1
  float outside = 0;           // Projected::outside_share(); NaN without a range image
  float described = 1;         // 0: the scan could not be described, its feature is all zero
};

/// To be raised with every change after which features differ beyond the last digits of a float:
/// kept features are then made again. The tests FeatureVersion.* hold a fixed scan's checksums.
constexpr int kFeatureVersion = 1;

/// Identifies the files of a data set by path, size, number and times of change of the content and
/// of the entry (which a copied time stamp does not hide), without reading them.
std::string dataset_key(const Dataset& dataset);

/// `folder/NAME-HASH.npy`; the hash is of `key`, which names all that the features depend on.
struct FeaturePaths {
  std::filesystem::path features;    // [n][dim]
  std::filesystem::path alignments;  // [n][6], AlignmentRecord
  std::string key;
};
FeaturePaths feature_paths(const std::filesystem::path& folder, const Dataset& dataset,
                           const FeatureExtractor& extractor, const DescribeOptions& options);

/// Describes every scan into `paths` (of camera_images() for a feature that sees images), from
/// where an earlier call ended. A damaged file is made again. Throws Interrupted, InputError for a
/// scan that cannot be read (with `strict`, described), Error when the disk is full.
DescribeTimes write_features(const FeaturePaths& paths, const Dataset& dataset,
                             const FeatureExtractor& extractor, const DescribeOptions& options);

/// Throws InputError.
std::vector<AlignmentRecord> read_alignments(const std::filesystem::path& file);

}  // namespace revisit::pipeline
