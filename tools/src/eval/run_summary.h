#pragma once

#include <filesystem>
#include <map>
#include <string>
#include <vector>

#include "reports.pb.h"

namespace revisit::cli {

struct FinishedRun {
  std::filesystem::path folder;
  reports::MetricsList metrics;
  reports::RunInfo info;
  std::map<std::string, std::string> settings;  // config.yaml, with current option names
};

/// Throws InputError if `folder` is not a run.
FinishedRun read_run(const std::filesystem::path& folder);

/// One row per task, settings and sequence, or with `over_sequences` per task and settings. Throws
/// UsageError if two runs of a row have the same data, because the deviation would be too small.
reports::Summary summarize_runs(const std::vector<FinishedRun>& runs, bool over_sequences = false);

}  // namespace revisit::cli
