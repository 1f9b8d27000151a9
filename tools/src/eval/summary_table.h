#pragma once

#include <iosfwd>
#include <string>
#include <vector>

#include "run_folder.h"

namespace revisit::cli {

/// `resamples`: of the confidence intervals; 0: none.
void print_summary(std::ostream& out, const std::vector<TaskResult>& results, int resamples);

void print_protocols(std::ostream& out);
/// JSON list of {name, definition, source}.
void print_protocols_json(std::ostream& out);

/// Prints nothing if `names` is empty.
void print_skipped(std::ostream& out, const std::vector<std::string>& names, int64_t n_scans);

}  // namespace revisit::cli
