#pragma once

#include <string>
#include <utility>
#include <vector>

#include "eval/feature_options.h"
#include "loops/pose_options.h"
#include "revisit/evaluation/evaluate.h"

namespace revisit::cli {

struct TruthOptions {
  PoseOptions poses;
  std::string pairs, pairs_ignore;  // files, separated by commas
  int pairs_near = 0;
  bool pairs_complete = false;

  void declare(Parser& parser);
  /// Throws UsageError, also for options of distances with --pairs.
  void check(const Parser& parser) const;
  bool has_own() const { return !pairs.empty() || !poses.file.empty(); }
  /// Scans of open_scans(), with the poses of the file if there is one.
  Dataset open(const FeatureOptions& data, const DatasetNeeds& needs) const;
  /// Absent without pairs. Throws what read_pairs() throws.
  std::optional<ListedPairs> listed(const FeatureOptions& data) const;
  /// Names and values, with absolute paths.
  std::vector<std::pair<std::string, std::string>> settings() const;
};

/// Note with the number of listed queries that cannot find their place; "" if there is none.
std::string listed_but_not_asked(const ListedPairs& listed, const TaskResult& result);

/// Absolute path of an existing file or folder, else `given` itself.
std::string placed(const std::filesystem::path& given);

}  // namespace revisit::cli
