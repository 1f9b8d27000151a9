#pragma once

#include <string>
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

  void declare(Options& options);
  bool has_own() const { return !pairs.empty() || !poses.file.empty(); }
  /// Scans of open_scans(), with the poses of the file if there is one.
  Dataset open(const FeatureOptions& data, bool needs_poses) const;
  /// Absent without pairs. Throws what read_pairs() throws.
  std::optional<ListedPairs> listed(const FeatureOptions& data) const;
};

/// Note with the number of listed queries that cannot find their place; "" if there is none.
std::string listed_but_not_asked(const ListedPairs& listed, const TaskResult& result);

}  // namespace revisit::cli
