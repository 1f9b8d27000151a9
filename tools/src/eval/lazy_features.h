#pragma once

#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "eval/feature_options.h"
#include "revisit/recognition/feature_file.h"

namespace revisit::cli {

/// The features of all inputs of `source` in one alignment mode, made when they are first asked
/// for, or taken from the cache `folder`. What is passed to the constructor must outlive it.
/// Progress on stderr; Ctrl-C throws Interrupted and keeps what was done. Scans that cannot be
/// described are named in warnings on stderr, and those without any description (all zero) counted;
/// with `options.strict` the first that cannot be described is an InputError. So it is when none
/// can be described.
class LazyFeatures {
 public:
  LazyFeatures(const FeatureOptions& options, const FeatureSource& source,
               pipeline::AlignCase align, std::filesystem::path folder);

  /// Names everything the features depend on.
  const std::string& key() const { return paths_.key; }
  /// Where they are or will be.
  const std::filesystem::path& path() const { return paths_.features; }
  int64_t n() const { return static_cast<int64_t>(source_.inputs.scans.size()); }
  const pipeline::FeatureFile& file();
  /// Of each scan; without the features where they are in the cache.
  const std::vector<pipeline::AlignmentRecord>& alignments();
  /// Rows of the scans that could not be described, ascending.
  std::vector<int64_t> left_out();
  /// What each scan took when it was described, in this process or an earlier one; the wall time
  /// is known to the process that did it.
  const pipeline::DescribeTimes& times();

 private:
  std::filesystem::path times_file() const;
  pipeline::DescribeTimes read_times() const;
  void warn_of_zeros(const pipeline::FeatureFile& features);
  void make();

  const FeatureOptions& options_;
  const FeatureSource& source_;
  pipeline::DescribeOptions describe_;
  bool made_ = false;  // and checked, by this process
  pipeline::FeaturePaths paths_;
  std::optional<pipeline::FeatureFile> file_;
  std::optional<std::vector<pipeline::AlignmentRecord>> alignments_;
  std::optional<pipeline::DescribeTimes> times_;
};

}  // namespace revisit::cli
