#pragma once

#include <string>

#include "reports.pb.h"
#include "revisit/pipeline/bootstrap.h"
#include "revisit/pipeline/precision_recall.h"

namespace revisit::cli {

/// The entry of metrics.json for one task. `pose_source` names where the ground truth comes from,
/// e.g. the poses file. What `summary` has as NaN (not computed) is left out.
reports::Metrics metrics_report(const pipeline::PrSummary& summary, const pipeline::Task& task,
                                const pipeline::TrueMatchRule& rule,
                                const std::string& pose_source);

/// Adds the intervals of `resamples` resamples; those not computed stay empty.
void add_intervals(reports::Metrics& metrics, const pipeline::PrIntervals& intervals,
                   int resamples);

}  // namespace revisit::cli
