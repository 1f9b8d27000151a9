#pragma once

#include "cli/table.h"
#include "reports.pb.h"

namespace revisit::cli {

/// A row per perturbation, six columns per feature.
Table robustness_table(const reports::Robustness& report);

/// A row per feature and perturbation, for CSV.
Table robustness_lines(const reports::Robustness& report);

/// True if queries, perturbations and map are the same, so that features are comparable.
bool same_question(const reports::Robustness& a, const reports::Robustness& b);

}  // namespace revisit::cli
