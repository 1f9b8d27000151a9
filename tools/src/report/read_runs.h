#pragma once

#include <filesystem>
#include <vector>

#include "reports.pb.h"

namespace revisit::cli {

/// Reads report.json, experiment.json with its runs and robustness.json in and below folders, and
/// (growing) files of `revisit loops --format jsonl`. A run of several experiments is read once.
/// Throws InputError for a folder without any of these, and for a file that revisit did not write.
reports::Page read_runs(const std::vector<std::filesystem::path>& folders);

}  // namespace revisit::cli
