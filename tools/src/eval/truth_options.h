#pragma once

#include <string>
#include <utility>
#include <vector>

#include "eval/feature_options.h"
#include "loops/pose_options.h"
#include "revisit/evaluation/evaluate.h"

namespace revisit::cli {

/// Where the truth of a recording comes from, beside its own poses: a file of poses, or pairs.
struct TruthOptions {
  PoseOptions poses;
  std::string pairs, pairs_ignore;  // files, by comma
  int pairs_near = 0;
  bool pairs_complete = false;

  void declare(Parser& parser);
  /// Throws UsageError, also for options about distances beside pairs.
  void check(const Parser& parser) const;
  bool has_own() const { return !pairs.empty() || !poses.file.empty(); }
  /// The scans of open_scans(), with the poses of the file if there is one.
  pipeline::Dataset open(const FeatureOptions& data, const pipeline::DatasetNeeds& needs) const;
  /// Nothing without pairs. Throws what read_pairs() does.
  std::optional<pipeline::ListedPairs> listed(const FeatureOptions& data) const;
  /// Names and values, with absolute paths.
  std::vector<std::pair<std::string, std::string>> settings() const;
};

/// How many listed queries have a place, and how many of these a task cannot find; "" when it finds
/// all.
std::string listed_but_not_asked(const pipeline::ListedPairs& listed,
                                 const pipeline::TaskResult& result);

/// An absolute path for a file or folder that exists; other words stay.
std::string placed(const std::filesystem::path& given);

}  // namespace revisit::cli
