#pragma once

#include <iosfwd>
#include <optional>
#include <vector>

#include "revisit/evaluation/evaluate.h"

namespace revisit::cli {

struct StageTimes {
  const char* name;
  const std::vector<double>& ms;
};
/// Omits stages without times.
std::vector<StageTimes> stages_of(const EvaluationTimes& times);

/// Scans per second of CPU time of one thread, from points to feature, as the paper measures.
std::optional<double> frames_per_second(const DescribeTimes& times);

/// Scans per second of all threads, from files to features; absent without scans.
std::optional<double> scans_per_second(const DescribeTimes& times);

void print_times(const EvaluationTimes& times, std::ostream& out);

}  // namespace revisit::cli
