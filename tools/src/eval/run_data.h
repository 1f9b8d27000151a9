#pragma once

#include "eval/run_folder.h"
#include "reports.pb.h"

namespace revisit::cli {

/// How many matches of a query can be shown with their range images.
inline constexpr int kShownMatches = 4;

/// What report.json holds: all that the page of a run shows, but range images. `info` and `metrics`
/// are those of run.json and metrics.json.
reports::Run run_data(const RunContext& context, const std::vector<pipeline::TaskResult>& results,
                      const reports::RunInfo& info, const reports::MetricsList& metrics);

/// The entry of metrics.json for one task. `pose_source` names where the ground truth comes from,
/// e.g. the poses file. What `summary` has as NaN (not computed) is left out.
reports::Metrics metrics_report(const pipeline::PrSummary& summary, const pipeline::Task& task,
                                const std::string& pose_source);

/// Adds the intervals of `resamples` resamples; those not computed stay empty.
void add_intervals(reports::Metrics& metrics, const pipeline::PrIntervals& intervals,
                   int resamples);

}  // namespace revisit::cli
