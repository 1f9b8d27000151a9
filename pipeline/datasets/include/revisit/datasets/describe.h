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

/// The result for a scan does not depend on other scans.
struct PerturbedScans {
  Perturbation perturbation;
  uint32_t seed = 0;
};

struct DescribeOptions {
  ImageGeometry geometry;
  AlignCase align = AlignCase::kOne;
  std::optional<PerturbedScans> perturbed;
  /// Scans processed at once, one thread each. Does not change the values.
  int threads = 1;
  /// True: a scan that cannot be described is an error, instead of getting a zero feature.
  bool strict = false;
  std::function<void(const ScanRef& scan, const std::string& why)> skipped;  // in order
  std::function<void(const std::string& file)> corrupt;                      // regenerated
  std::function<void(int64_t done, int64_t total)> progress;                 // [scans]
  std::function<bool()> stop;  // true: throw Interrupted
};

/// [ms] on one thread, for each scan described in this process.
struct DescribeTimes {
  std::vector<double> read, align, project, close, feature, write;
  double wall_ms = 0;  // all threads
  /// CPU time from points or image in memory to the feature; other processes do not affect it.
  std::vector<double> processor;

  void append(const DescribeTimes& more);
};

/// 6 floats, the first four as in Alignment; NaN if unknown: images, skipped scans, clouds without
/// direction.
struct AlignmentRecord {
  float yaw = 0;  // [rad]
  float eigenvalue_ratio = 0;
  float abs_t11 = 0;
  float mirrored_choice = 0;  // 0 or 1
  float outside = 0;          // Projected::outside_share(); NaN without a range image
  float described = 1;        // 0: the scan could not be described, its feature is all zero
};

/// Must be incremented with every change that alters features beyond the last digits of a float,
/// because features are cached. The tests FeatureVersion.* check a fixed scan's checksums.
constexpr int kFeatureVersion = 1;

/// Fingerprint of a data set's files: path, size, inode, and change times of content (mtime) and
/// inode (ctime). A copied mtime does not hide a change. The files are not read.
std::string dataset_key(const Dataset& dataset);

/// `folder/NAME-HASH.npy`; HASH is of `key`, which identifies everything the features depend on.
struct FeaturePaths {
  std::filesystem::path features;    // [n][dim]
  std::filesystem::path alignments;  // [n][6], AlignmentRecord
  std::string key;
};
FeaturePaths feature_paths(const std::filesystem::path& folder, const Dataset& dataset,
                           const FeatureExtractor& extractor, const DescribeOptions& options);

/// Describes every scan into `paths` and resumes after an interruption. A feature of images needs
/// the result of camera_images(). A corrupt file is regenerated. Throws Interrupted, InputError for
/// a scan that cannot be read (with `strict`: described), Error if the disk is full.
DescribeTimes write_features(const FeaturePaths& paths, const Dataset& dataset,
                             const FeatureExtractor& extractor, const DescribeOptions& options);

/// Throws InputError.
std::vector<AlignmentRecord> read_alignments(const std::filesystem::path& file);

/// Features of all scans, computed on first use or read from the cache folder. Warns of scans that
/// cannot be described (InputError if `strict`, or if none can) and of features that are all zero.
class DatasetFeatures {
 public:
  /// Refers to `dataset` (the result of camera_images() for a feature of camera images),
  /// `extractor` and `observer`. Of `options` it uses geometry, align, threads and strict.
  DatasetFeatures(const Dataset& dataset, const FeatureExtractor& extractor,
                  const DescribeOptions& options, const std::filesystem::path& folder,
                  const Observer& observer);
  DatasetFeatures(const DatasetFeatures&) = delete;
  DatasetFeatures& operator=(const DatasetFeatures&) = delete;

  const std::string& key() const { return paths_.key; }
  const FeatureExtractor& extractor() const { return extractor_; }
  const std::filesystem::path& path() const { return paths_.features; }
  int64_t n() const { return static_cast<int64_t>(dataset_.scans.size()); }
  /// [n][dim]. Throws what write_features() throws; after Interrupted, the next call resumes.
  const FeatureFile& file();
  /// Does not compute the features if the alignments are cached.
  const std::vector<AlignmentRecord>& alignments();
  /// Rows of scans that could not be described, ascending.
  std::vector<int64_t> skipped();
  /// Times of this process or an earlier one; wall time only of this process.
  const DescribeTimes& times();

 private:
  std::filesystem::path times_file() const;
  DescribeTimes read_times() const;
  void warn_of_zeros(const FeatureFile& features);
  void make();

  const Dataset& dataset_;
  const FeatureExtractor& extractor_;
  const Observer& observer_;
  DescribeOptions options_;
  bool made_ = false;  // computed and checked by this process
  FeaturePaths paths_;
  std::optional<FeatureFile> file_;
  std::optional<std::vector<AlignmentRecord>> alignments_;
  std::optional<DescribeTimes> times_;
};

}  // namespace revisit
