#pragma once

#include <filesystem>
#include <map>
#include <string>
#include <vector>

#include "reports.pb.h"

namespace revisit::cli {

/// What `revisit eval` left in a folder.
struct FinishedRun {
  std::filesystem::path folder;
  reports::MetricsList metrics;
  reports::RunInfo info;
  std::map<std::string, std::string> settings;  // config.yaml
};

/// Throws InputError when `folder` is not a run.
FinishedRun read_run(const std::filesystem::path& folder);

/// Mean and deviation of every task over runs that differ only in the data: a row for each task,
/// settings and sequence, or over the sequences, too. Throws UsageError when two runs of a row are
/// of the same data, which would make the deviation too small.
reports::Summary summarize_runs(const std::vector<FinishedRun>& runs, bool over_sequences = false);

}  // namespace revisit::cli
