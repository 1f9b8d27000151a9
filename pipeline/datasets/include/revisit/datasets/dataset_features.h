#pragma once

#include <filesystem>
#include <optional>
#include <vector>

#include "revisit/datasets/describe.h"
#include "revisit/datasets/observer.h"
#include "revisit/recognition/feature_file.h"

namespace revisit {

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
