#pragma once

#include <filesystem>
#include <vector>

#include "reports.pb.h"

namespace revisit::cli {

/// Reads runs (report.json), experiments (experiment.json, with their runs) and tables of
/// robustness (robustness.json) in and below folders, and files of `revisit loops --format jsonl`,
/// whose last line may still be written. A run of several experiments is there once. Throws
/// InputError for a folder without any of these, and for files that are not as revisit writes them.
reports::Page read_runs(const std::vector<std::filesystem::path>& folders);

}  // namespace revisit::cli
