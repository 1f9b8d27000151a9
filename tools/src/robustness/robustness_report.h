#pragma once

#include "cli/table.h"
#include "reports.pb.h"

namespace revisit::cli {

/// Table for people: a row per perturbation, six columns per feature.
Table robustness_table(const reports::Robustness& report);

/// Table for programs: a line per feature and perturbation.
Table robustness_lines(const reports::Robustness& report);

/// True if both have the same queries, perturbations and map, so that their features are
/// comparable.
bool same_question(const reports::Robustness& a, const reports::Robustness& b);

}  // namespace revisit::cli
