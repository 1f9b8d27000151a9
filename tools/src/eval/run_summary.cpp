#include "run_summary.h"

#include <cmath>
#include <set>

#include "cli/json.h"
#include "config_file.h"
#include "revisit/base/error.h"

namespace revisit::cli {
namespace {

namespace fs = std::filesystem;

/// Settings that have columns of their own or cannot change a metric.
const std::set<std::string> kNotCompared = {"sequence", "protocol", "bootstrap", "memory"};

/// Settings in which the runs differ, "key=value key=value".
std::string differing(const FinishedRun& run, const std::vector<FinishedRun>& runs) {
  std::set<std::string> keys;
  for (const FinishedRun& other : runs)
    for (const auto& [key, value] : other.settings) keys.insert(key);
  std::string text;
  const auto value_of = [](const FinishedRun& of, const std::string& key) {
    const auto found = of.settings.find(key);
    return found == of.settings.end() ? "" : found->second;
  };
  for (const std::string& key : keys) {
    if (kNotCompared.contains(key)) continue;
    bool differs = false;
    for (const FinishedRun& other : runs) differs |= value_of(other, key) != value_of(run, key);
    if (differs) text += str(text.empty() ? "" : " ", key, "=", value_of(run, key));
  }
  return text;
}

std::string row_key(const FinishedRun& run, const reports::Metrics& task, bool over_sequences) {
  std::string key = str(task.protocol(), "\n", task.definition(), "\n", task.radius_m(), " ",
                        task.false_beyond_m(), " ", task.distance(), " ", task.exclusion(), " ",
                        task.score(), "\n", over_sequences ? "" : run.info.sequence(), "\n",
                        run.info.feature(), " ", run.info.weights_sha1());
  for (const auto& [name, value] : run.settings)
    if (!kNotCompared.contains(name)) key += str("\n", name, "=", value);
  return key;
}

/// Fields of reports::Metrics and reports::SummaryRow.
constexpr const char* kFigures[] = {"average_precision", "f1_max", "max_recall_at_precision_1",
                                    "recall_at_1", "extended_precision"};

reports::Spread spread_of(const std::vector<double>& values) {
  const auto n = static_cast<double>(values.size());
  double sum = 0, squares = 0;
  for (const double value : values) sum += value;
  for (const double value : values) squares += (value - sum / n) * (value - sum / n);
  reports::Spread spread;
  spread.set_mean(sum / n);
  if (values.size() > 1) spread.set_deviation(std::sqrt(squares / (n - 1)));
  spread.set_runs(static_cast<int>(values.size()));
  return spread;
}

struct RowOfRuns {
  reports::SummaryRow report;
  std::map<std::pair<std::string, std::string>, std::string> folder_of_drive;  // data, sequence
  std::set<std::string> sequences;
  std::map<std::string, std::vector<double>> values;  // by metric, of the runs that have it
};

void add(RowOfRuns& row, const FinishedRun& run, const reports::Metrics& task) {
  const auto [earlier, fresh] =
      row.folder_of_drive.try_emplace({run.info.data(), run.info.sequence()}, run.folder.string());
  if (!fresh)
    throw UsageError(run.folder.string(), " and ", earlier->second,
                     " are runs with the same settings on the same data, ", run.info.data(), " ",
                     run.info.sequence(), "; give each drive once");
  row.sequences.insert(run.info.sequence());
  row.report.add_folders(run.folder.string());
  for (const char* figure : kFigures) {
    const auto* const field = task.GetDescriptor()->FindFieldByName(figure);
    if (task.GetReflection()->HasField(task, field))
      row.values[figure].push_back(task.GetReflection()->GetDouble(task, field));
  }
}

}  // namespace

FinishedRun read_run(const fs::path& folder) {
  FinishedRun run;
  run.folder = folder;
  if (!fs::exists(folder / "metrics.json"))
    throw InputError(folder.string(),
                     ": no metrics.json; expected a folder that `revisit eval` "
                     "wrote, e.g. results/town_00/latest");
  read_report(folder / "metrics.json", &run.metrics);
  read_report(folder / "run.json", &run.info);
  for (auto& [name, value] : read_config_file(folder / "config.yaml"))
    run.settings[name] = std::move(value);
  return run;
}

reports::Summary summarize_runs(const std::vector<FinishedRun>& runs, bool over_sequences) {
  std::vector<RowOfRuns> rows;
  std::map<std::string, size_t> row_of;
  for (const FinishedRun& run : runs)
    for (const reports::Metrics& task : run.metrics.tasks()) {
      const auto [at, fresh] = row_of.try_emplace(row_key(run, task, over_sequences), rows.size());
      if (fresh) {
        reports::SummaryRow& row = rows.emplace_back().report;
        row.set_protocol(task.protocol());
        row.set_feature(run.info.feature());
        row.set_settings(differing(run, runs));
      }
      add(rows[at->second], run, task);
    }
  reports::Summary summary;
  for (RowOfRuns& row : rows) {
    row.report.set_runs(row.report.folders_size());
    std::string sequences;
    for (const std::string& name : row.sequences)
      sequences += (sequences.empty() ? "" : " ") + name;
    row.report.set_sequence(sequences);
    for (const auto& [figure, values] : row.values)
      row.report.GetReflection()
          ->MutableMessage(&row.report, row.report.GetDescriptor()->FindFieldByName(figure))
          ->CopyFrom(spread_of(values));
    *summary.add_rows() = row.report;
  }
  return summary;
}

}  // namespace revisit::cli
