#pragma once

#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "eval/feature_options.h"
#include "revisit/pipeline/feature_file.h"

namespace revisit::cli {

/// The features of all inputs of `source` in one alignment mode, made when they are first asked
/// for, or taken from the cache `folder`. What is passed to the constructor must outlive it.
/// Progress on stderr; Ctrl-C throws Interrupted and keeps what was done. Scans without any
/// description (all zero) are counted in a warning on stderr.
class LazyFeatures {
 public:
  LazyFeatures(const FeatureOptions& options, const FeatureSource& source,
               pipeline::AlignMode align, std::filesystem::path folder);

  /// Names everything the features depend on.
  const std::string& key() const { return paths_.key; }
  /// Where they are or will be.
  const std::filesystem::path& path() const { return paths_.features; }
  int64_t n() const { return static_cast<int64_t>(source_.inputs.scans.size()); }
  const pipeline::FeatureFile& file();
  /// Of each scan; without the features where they are in the cache.
  const std::vector<pipeline::AlignmentRecord>& alignments();
  /// What each scan took when it was described, in this process or an earlier one; the wall time
  /// is known to the process that did it.
  const pipeline::DescribeTimes& times();

 private:
  std::filesystem::path times_file() const;
  void make();

  const FeatureOptions& options_;
  const FeatureSource& source_;
  pipeline::DescribeOptions describe_;
  pipeline::FeaturePaths paths_;
  std::optional<pipeline::FeatureFile> file_;
  std::optional<std::vector<pipeline::AlignmentRecord>> alignments_;
  std::optional<pipeline::DescribeTimes> times_;
};

}  // namespace revisit::cli
