#pragma once

#include <filesystem>
#include <vector>

#include "reports.pb.h"

namespace revisit::cli {

/// A page with what is in folders of runs (report.json), of experiments (experiment.json, with
/// their runs), of tables of robustness (robustness.json), in folders that have such below them, and in files of loops (`revisit loops
/// --format jsonl`), whose last line may still be written. A run that several experiments share is
/// there once. Throws InputError for a folder with neither and for files that are not as revisit
/// writes them.
reports::Page read_runs(const std::vector<std::filesystem::path>& folders);

}  // namespace revisit::cli
