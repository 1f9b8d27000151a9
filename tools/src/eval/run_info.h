#pragma once

#include <string>

#include "feature_options.h"
#include "reports.pb.h"
#include "run_times.h"

namespace revisit::cli {

/// Content of run.json.
reports::RunInfo run_info(const FeatureOptions& options, const Dataset& dataset,
                          const FeatureSource& source, const std::string& pca_fit,
                          const EvaluationTimes& times,
                          const std::vector<AlignmentRecord>& alignments);

}  // namespace revisit::cli
