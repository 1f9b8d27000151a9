#pragma once

#include "cli/table.h"
#include "reports.pb.h"

namespace revisit::cli {

/// Alterations down, for each feature six columns: for people.
Table robustness_table(const reports::Robustness& report);

/// A line for each feature and alteration: for programs.
Table robustness_lines(const reports::Robustness& report);

/// Whether both asked the same scans, altered alike, for the same places: then their features can
/// stand side by side.
bool same_question(const reports::Robustness& a, const reports::Robustness& b);

}  // namespace revisit::cli
