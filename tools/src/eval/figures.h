#pragma once

#include <filesystem>
#include <vector>

#include "eval/run_folder.h"

namespace revisit::cli {

/// The figures of a run, each as data, gnuplot script, PNG and SVG: precision-recall of all tasks
/// (`precision_recall`), and for each task the drive with right and wrong matches
/// (`trajectory_<task>`), the score histogram (`scores_<task>`) and one recognised place with its
/// range images (`match_<task>`); of tasks that decide on pairs,
/// and without poses, only the histogram. A missing
/// gnuplot is a warning on stderr. Throws Error when files cannot be written.
void write_figures(const std::filesystem::path& run, const RunContext& context,
                   const std::vector<TaskResult>& results, pipeline::AlignMode align);

}  // namespace revisit::cli
