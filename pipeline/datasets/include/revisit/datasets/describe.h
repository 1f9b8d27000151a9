#pragma once

#include <cstdint>
#include <filesystem>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "revisit/datasets/dataset.h"
#include "revisit/datasets/observer.h"
#include "revisit/datasets/perturbation.h"
#include "revisit/recognition/feature.h"
#include "revisit/recognition/feature_file.h"

namespace revisit {

/// How the scans of a data set become features.
struct DescribeOptions {
  ImageGeometry geometry;             ///< of range images
  AlignCase align = AlignCase::kOne;  ///< before the projection
  Perturbation perturbation;          ///< of every scan; the result does not depend on other scans
  uint32_t seed = 0;                  ///< of the perturbation
  /// Scans processed at once, one thread each. Does not change the values.
  int threads = 1;
  /// True: a scan that cannot be described is an error, instead of getting a zero feature.
  bool strict = false;
};

/// [ms] on one thread, for each scan described in this process.
struct DescribeTimes {
  std::vector<double> read, align, project, close, feature, write;  ///< per step
  double wall_ms = 0;                                               ///< all threads
  /// CPU time from points or image in memory to the feature; other processes do not affect it.
  std::vector<double> processor;

  void append(const DescribeTimes& more);  ///< adds times of other scans
};

/// 6 floats, the first four as in Alignment; NaN if unknown: images, skipped scans, clouds without
/// direction.
struct AlignmentRecord {
  float yaw = 0;               ///< [rad]
  float eigenvalue_ratio = 0;  ///< l1/l2; near 1: the direction is ambiguous
  float abs_t11 = 0;           ///< |t11|; near 0: its sign is
  float mirrored_choice = 0;   ///< 0 or 1
  float outside = 0;           ///< RangeImage::outside_share(); NaN without a range image
  float described = 1;         ///< 0: the scan could not be described, its feature is all zero
};

/// Must be incremented with every change that alters features beyond the last digits of a float,
/// because features are cached. The tests FeatureVersion.* check a fixed scan's checksums.
constexpr int kFeatureVersion = 3;

/// Fingerprint of a data set's files: path, size, inode, and change times of content (mtime) and
/// inode (ctime). A copied mtime does not hide a change. The files are not read.
std::string dataset_key(const Dataset& dataset);

/// Reads the record of scan `i` from a file of DatasetFeatures. Throws InputError for other files.
AlignmentRecord alignment_of(const FeatureFile& features, int64_t i);

/// Features of all scans, computed on first use or read from `folder/NAME-HASH.features`; HASH is
/// of key(), which identifies everything the features depend on. A row of the file has the feature
/// and its AlignmentRecord. Describing resumes after an interruption; a corrupt file is
/// regenerated, with a note. Warns of scans that cannot be described (InputError if `strict`, or if
/// none can) and of features that are all zero.
class DatasetFeatures {
 public:
  /// Refers to `dataset` (the result of camera_images() for a feature of camera images),
  /// `extractor` and `observer`.
  DatasetFeatures(const Dataset& dataset, const FeatureExtractor& extractor,
                  const DescribeOptions& options, const std::filesystem::path& folder,
                  const Observer& observer);
  DatasetFeatures(const DatasetFeatures&) = delete;
  DatasetFeatures& operator=(const DatasetFeatures&) = delete;

  const std::string& key() const { return key_; }  ///< identifies all that features depend on
  const FeatureExtractor& extractor() const { return extractor_; }  ///< the feature
  const std::filesystem::path& path() const { return path_; }       ///< of file(), existing or not
  /// Number of scans.
  int64_t n() const { return static_cast<int64_t>(dataset_.scans.size()); }
  /// [n][dim]. Throws Interrupted (the next call resumes), InputError for a scan that cannot be
  /// read (with `strict`: described), Error if the disk is full.
  const FeatureFile& file();
  const std::vector<AlignmentRecord>& alignments();  ///< per scan
  /// Rows of scans that could not be described, ascending.
  std::vector<int64_t> skipped();
  /// Times of this process or an earlier one; wall time only of this process.
  const DescribeTimes& times();

 private:
  std::filesystem::path times_file() const;
  DescribeTimes read_times() const;
  const FeatureFile& open();
  void warn_of_zeros();

  const Dataset& dataset_;
  const FeatureExtractor& extractor_;
  const Observer& observer_;
  DescribeOptions options_;
  std::string key_;
  std::filesystem::path path_;
  bool zeros_counted_ = false;
  std::optional<FeatureFile> file_;
  std::optional<std::vector<AlignmentRecord>> alignments_;
  std::optional<DescribeTimes> times_;
};

}  // namespace revisit
