#pragma once

#include <iosfwd>
#include <string>
#include <vector>

#include "run_folder.h"

namespace revisit::cli {

/// The figures of all tasks, with confidence intervals (of `resamples` resamples) if any.
void print_summary(std::ostream& out, const std::vector<pipeline::TaskResult>& results,
                   int resamples);

/// Prints every protocol with its definition and source, for `--protocol list`.
void print_protocols(std::ostream& out);
/// Prints them as a JSON list of {name, definition, source}.
void print_protocols_json(std::ostream& out);

/// Prints the number of skipped scans and the first few names, or nothing if there are none.
void print_skipped(std::ostream& out, const std::vector<std::string>& names, int64_t n_scans);

}  // namespace revisit::cli
