#pragma once

#include <iosfwd>
#include <optional>
#include <vector>

#include "revisit/evaluation/evaluate.h"

namespace revisit::cli {

/// One stage, with its times [ms] in the order they were measured.
struct StageTimes {
  const char* name;
  const std::vector<double>& ms;
};
/// The stages that took place, in their order.
std::vector<StageTimes> stages_of(const pipeline::EvaluationTimes& times);

/// Scans a second of one thread's processor time, from memory to feature, as the paper's speeds.
std::optional<double> frames_per_second(const pipeline::DescribeTimes& times);

/// Scans a second of all threads together, from files to features; nothing without scans.
std::optional<double> scans_per_second(const pipeline::DescribeTimes& times);

/// Median, 95th percentile and sum of each stage, and the speed; nothing for an idle run.
void print_times(const pipeline::EvaluationTimes& times, std::ostream& out);

}  // namespace revisit::cli
