#include <set>

#include "cli/command.h"
#include "cli/json.h"
#include "cli/options.h"
#include "cli/table.h"
#include "eval/run_summary.h"

namespace revisit::cli {
namespace {

namespace fs = std::filesystem;

struct SummarizeOptions {
  std::vector<fs::path> runs;
  std::string format = "table";
  bool over_sequences = false;

  void declare(Options& options);
};

void SummarizeOptions::declare(Options& options) {
  options.argument("RUN", &runs)
      .flag("over-sequences", "mean over several sequences", &over_sequences)
      .choice("format", {"table", "json", "csv"}, "format of standard output (default table)",
              &format);
}

Table table_of(const reports::Summary& summary) {
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

int summarize(const SummarizeOptions& o) {
  std::vector<FinishedRun> runs;
  std::set<fs::path> seen;  // `results/town/*` has the last run twice, also as `latest`
  for (const fs::path& folder : o.runs) {
    std::error_code error;
    const fs::path real = fs::canonical(folder, error);
    if (error) throw InputError(folder.string(), ": ", error.message());
    if (seen.insert(real).second) runs.push_back(read_run(real));
  }
  const reports::Summary summary = summarize_runs(runs, o.over_sequences);
  print_report(o.format, summary, table_of(summary));
  return kOk;
}

}  // namespace

Command summarize_command() {
  return {
      "summarize", "mean and standard deviation over runs, e.g. of several seeds",
      "Mean and sample standard deviation of the metrics of several runs of `revisit eval`, such "
      "as the seeds of a simulated drive. RUN is a folder of a run. Runs with other settings or "
      "another sequence have a row of their own; --over-sequences averages over sequences, too.",
      "  for seed in 1 2 3; do\n"
      "    revisit simulate --seed $seed -o town$seed\n"
      "    revisit eval town$seed --feature data -o results\n"
      "  done\n"
      "  revisit summarize results/town*/latest\n"
      "  revisit summarize --over-sequences results/kitti_*/latest\n",
      with_options<SummarizeOptions>(summarize)};
}

}  // namespace revisit::cli
