#pragma once

#include <iosfwd>
#include <vector>

#include "run_folder.h"

namespace revisit::cli {

/// The figures of all tasks as a table, with a line of confidence intervals (of `resamples`
/// resamples) below each that has them.
void print_summary(std::ostream& out, const std::vector<TaskResult>& results, int resamples);

/// What `--protocol list` prints: every protocol with its definition and source.
void print_protocols(std::ostream& out);

}  // namespace revisit::cli
