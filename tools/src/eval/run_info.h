#pragma once

#include <string>

#include "feature_options.h"
#include "reports.pb.h"
#include "run_times.h"

namespace revisit::cli {

/// What run.json holds: what was described, how, and how long it took.
reports::RunInfo run_info(const FeatureOptions& options, const pipeline::Dataset& dataset,
                          const FeatureSource& source, const std::string& pca_fit,
                          const pipeline::EvaluationTimes& times);

/// Adds the scans that could not be described.
void add_left_out(reports::RunInfo& info, const pipeline::Dataset& dataset,
                  const std::vector<pipeline::AlignmentRecord>& alignments);

}  // namespace revisit::cli
