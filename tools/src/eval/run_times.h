#pragma once

#include <chrono>
#include <iosfwd>
#include <optional>
#include <vector>

#include "revisit/datasets/describe.h"

namespace revisit::cli {

/// Where the time of a run went. Of scans that an earlier run described, what it took then.
struct RunTimes {
  pipeline::DescribeTimes describe;
  std::vector<double> reduce, retrieve;  // [ms], all threads together, of each task
};

/// One stage, with its times [ms] in the order they were measured.
struct StageTimes {
  const char* name;
  const std::vector<double>& ms;
};
/// The stages that took place, in their order.
std::vector<StageTimes> stages_of(const RunTimes& times);

/// Scans a second of one thread's processor time, from points (or a camera image) in memory to the
/// feature, as the paper gives speeds; nothing when no scan was described.
std::optional<double> frames_per_second(const pipeline::DescribeTimes& times);

/// Scans a second of all threads together, from files to features; nothing when no scan was
/// described.
std::optional<double> scans_per_second(const pipeline::DescribeTimes& times);

/// Median, 95th percentile and sum of each stage, and the speed; nothing for a run that had
/// nothing to do.
void print_times(const RunTimes& times, std::ostream& out);

/// What calling `work()` takes [ms].
template <class Work>
double milliseconds_of(const Work& work) {
  const auto start = std::chrono::steady_clock::now();
  work();
  return std::chrono::duration<double, std::milli>(std::chrono::steady_clock::now() - start)
      .count();
}

}  // namespace revisit::cli
