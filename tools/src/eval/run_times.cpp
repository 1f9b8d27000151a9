#include "run_times.h"

#include <numeric>
#include <ostream>

#include "cli/table.h"
#include "revisit/profiling/profile.h"

namespace revisit::cli {
namespace {

double sum_of(const std::vector<double>& values) {
  return std::accumulate(values.begin(), values.end(), 0.0);
}

}  // namespace

std::vector<StageTimes> stages_of(const EvaluationTimes& times) {
  const DescribeTimes& d = times.describe;
  std::vector<StageTimes> stages;
  for (const StageTimes& stage : {StageTimes{"read", d.read},
                                  {"align", d.align},
                                  {"project", d.project},
                                  {"close", d.close},
                                  {"feature", d.feature},
                                  {"write", d.write},
                                  {"reduce", times.reduce},
                                  {"retrieve", times.retrieve},
                                  {"recognise", times.recognize}})
    if (!stage.ms.empty()) stages.push_back(stage);
  return stages;
}

std::optional<double> frames_per_second(const DescribeTimes& times) {
  const double total_ms = sum_of(times.processor);
  if (!(total_ms > 0)) return std::nullopt;
  return 1000 * static_cast<double>(times.processor.size()) / total_ms;
}

std::optional<double> scans_per_second(const DescribeTimes& times) {
  if (times.feature.empty() || !(times.wall_ms > 0)) return std::nullopt;
  return 1000 * static_cast<double>(times.feature.size()) / times.wall_ms;
}

void print_times(const EvaluationTimes& times, std::ostream& out) {
  Table table({"stage", "times", "median ms", "p95 ms", "total s"});
  for (const StageTimes& stage : stages_of(times)) {
    const profiling::Timing timing = profiling::summarize(stage.ms);
    table.row({stage.name, str(stage.ms.size()), number(timing.median, 2), number(timing.p95, 2),
               number(sum_of(stage.ms) / 1000, 1)});
  }
  table.print(out);
  if (const auto speed = scans_per_second(times.describe))
    out << "described " << times.describe.feature.size() << " scans in "
        << number(times.describe.wall_ms / 1000, 1) << " s: " << number(*speed, 1) << " scans/s\n";
}

}  // namespace revisit::cli
