#include <cmath>
#include <set>

#include "report/report.h"
#include "revisit/base/error.h"

namespace revisit::cli {
namespace {

using Runs = google::protobuf::RepeatedPtrField<reports::Run>;

/// Settings that have columns of their own or cannot change a metric.
const std::set<std::string> kNotCompared = {"sequence", "protocol", "feature", "bootstrap",
                                            "memory"};

std::string value_of(const reports::Run& run, const std::string& setting) {
  const auto found = run.configuration().find(setting);
  return found == run.configuration().end() ? "" : found->second;
}

/// Settings in which the runs of `revisit eval` differ, "key=value key=value".
std::string differing(const reports::Run& run, const Runs& runs) {
  std::string text;
  const std::map<std::string, std::string> settings(run.configuration().begin(),
                                                    run.configuration().end());
  for (const auto& [key, value] : settings) {
    if (kNotCompared.contains(key) || value.empty()) continue;
    bool differs = false;
    for (const reports::Run& other : runs)
      differs |= !other.configuration().empty() && value_of(other, key) != value;
    if (differs) text += str(text.empty() ? "" : " ", key, "=", value);
  }
  return text;
}

std::string row_key(const reports::Run& run, const reports::Metrics& task, bool over_sequences) {
  std::string key = str(task.protocol(), "\n", task.definition(), "\n", task.radius_m(), " ",
                        task.negative_radius_m(), " ", task.distance(), " ", task.exclusion(), " ",
                        task.score(), "\n", over_sequences ? "" : run.info().sequence(), "\n",
                        run.info().feature(), " ", run.info().weights_sha1());
  const std::map<std::string, std::string> settings(run.configuration().begin(),
                                                    run.configuration().end());
  for (const auto& [name, value] : settings)
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

struct SummarizedRow {
  reports::SummaryRow report;
  /// By data and sequence: folder and metrics of the last run.
  std::map<std::pair<std::string, std::string>, std::pair<std::string, const reports::Metrics*>>
      drives;
};

void complete(SummarizedRow& row) {
  std::map<std::string, std::vector<double>> values;  // of the runs that have the figure
  std::set<std::string> sequences;
  for (const auto& [drive, run] : row.drives) {
    const auto& [folder, task] = run;
    sequences.insert(drive.second);
    row.report.add_folders(folder);
    for (const char* figure : kFigures) {
      const auto* const field = task->GetDescriptor()->FindFieldByName(figure);
      if (task->GetReflection()->HasField(*task, field))
        values[figure].push_back(task->GetReflection()->GetDouble(*task, field));
    }
  }
  row.report.set_runs(row.report.folders_size());
  row.report.set_sequence(joined(sequences, " "));
  for (const auto& [figure, of_runs] : values)
    row.report.GetReflection()
        ->MutableMessage(&row.report, row.report.GetDescriptor()->FindFieldByName(figure))
        ->CopyFrom(spread_of(of_runs));
}

}  // namespace

reports::Summary summarize_runs(const Runs& runs, bool over_sequences) {
  std::vector<SummarizedRow> rows;
  std::map<std::string, size_t> row_of;
  for (const reports::Run& run : runs)
    for (const reports::RunTask& task : run.tasks()) {
      const reports::Metrics& metrics = task.metrics();
      if (metrics.has_self()) continue;
      const auto [at, fresh] =
          row_of.try_emplace(row_key(run, metrics, over_sequences), rows.size());
      if (fresh) {
        reports::SummaryRow& row = rows.emplace_back().report;
        row.set_protocol(metrics.protocol());
        row.set_feature(run.info().feature());
        row.set_settings(differing(run, runs));
      }
      rows[at->second].drives[{run.info().data(), run.info().sequence()}] = {run.folder(),
                                                                             &metrics};
    }
  reports::Summary summary;
  for (SummarizedRow& row : rows) {
    complete(row);
    *summary.add_rows() = row.report;
  }
  return summary;
}

Table summary_table(const reports::Summary& summary) {
  Table table({"task", "sequence", "feature", "settings", "runs", "AP", "AP sd", "F1 max",
               "F1 max sd", "recall@100%P", "recall@100%P sd", "recall@1", "recall@1 sd", "EP",
               "EP sd"});
  for (const reports::SummaryRow& row : summary.rows()) {
    std::vector<std::string> cells{row.protocol(), row.sequence(), row.feature(), row.settings(),
                                   str(row.runs())};
    const auto add = [&](bool computed, const reports::Spread& spread) {
      cells.push_back(computed ? number(spread.mean(), 4) : "");
      cells.push_back(spread.has_deviation() ? number(spread.deviation(), 4) : "");
    };
    add(row.has_average_precision(), row.average_precision());
    add(row.has_f1_max(), row.f1_max());
    add(row.has_max_recall_at_precision_1(), row.max_recall_at_precision_1());
    add(row.has_recall_at_1(), row.recall_at_1());
    add(row.has_extended_precision(), row.extended_precision());
    table.row(std::move(cells));
  }
  return table;
}

}  // namespace revisit::cli
