#pragma once

#include <iosfwd>
#include <string>
#include <vector>

#include "eval/evaluation.h"

namespace revisit::cli {

/// Metrics of all tasks, and the matches of tasks with few queries.
void print_results(std::ostream& out, const FinishedEvaluation& evaluation, int resamples);

void print_protocols(std::ostream& out);
/// JSON list of {name, definition, source}.
void print_protocols_json(std::ostream& out);

/// Prints nothing if `names` is empty.
void print_skipped(std::ostream& out, const std::vector<std::string>& names, int64_t n_scans);

}  // namespace revisit::cli
