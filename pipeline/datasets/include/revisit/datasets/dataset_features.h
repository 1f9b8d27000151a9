#pragma once

#include <filesystem>
#include <optional>
#include <vector>

#include "revisit/datasets/describe.h"
#include "revisit/datasets/observer.h"
#include "revisit/recognition/feature_file.h"

namespace revisit::pipeline {

/// Features of all scans, made when first asked for or taken from the folder. Warns of scans that
/// cannot be described (InputError if `strict`, or if none can) and of features that are all zero.
class DatasetFeatures {
 public:
  /// `dataset` (for a feature that sees camera images, one of camera_images()), `extractor` and
  /// `observer` are referred to. Of `options` uses geometry, align, threads and strict.
  DatasetFeatures(const Dataset& dataset, const FeatureExtractor& extractor,
                  const DescribeOptions& options, const std::filesystem::path& folder,
                  const Observer& observer);
  DatasetFeatures(const DatasetFeatures&) = delete;
  DatasetFeatures& operator=(const DatasetFeatures&) = delete;

  const std::string& key() const { return paths_.key; }
  const FeatureExtractor& extractor() const { return extractor_; }
  const std::filesystem::path& path() const { return paths_.features; }
  int64_t n() const { return static_cast<int64_t>(dataset_.scans.size()); }
  /// The features [n][dim]. Throws what write_features() throws; Interrupted keeps what was done.
  const FeatureFile& file();
  /// Of each scan; without the features where they are in the folder.
  const std::vector<AlignmentRecord>& alignments();
  /// Rows of the scans that could not be described, ascending.
  std::vector<int64_t> left_out();
  /// Times of every scan, in this process or an earlier one; wall time only of this process.
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
  bool made_ = false;  // and checked, by this process
  FeaturePaths paths_;
  std::optional<FeatureFile> file_;
  std::optional<std::vector<AlignmentRecord>> alignments_;
  std::optional<DescribeTimes> times_;
};

}  // namespace revisit::pipeline
