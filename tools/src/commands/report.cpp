#include "report/report.h"

#include <iostream>

#include "cli/command.h"
#include "cli/json.h"
#include "cli/options.h"
#include "cli/shell.h"
#include "cli/terminal.h"
#include "revisit/base/files.h"

namespace revisit::cli {
namespace fs = std::filesystem;
namespace {

struct ReportOptions {
  std::vector<fs::path> folders;
  fs::path output = "report.html";
  std::string format = "table";
  PageOptions page;
  bool quiet = false, force = false;

  void declare(Options& options) {
    options.argument("FOLDER", &folders);
    options.group("Output:");
    options.option("output", "FILE", "the HTML file (default report.html)", &output, 'o');
    options.format({"table", "json", "csv"}, &format)
        .flag("over-sequences", "mean over several sequences", &page.over_sequences)
        .option("queries", "N",
                "queries with range images, for each of incorrect, missed and correct (default 3)",
                &page.queries)
        .at_least(0);
    options.flag("force", "replacement of files that are not reports", &force);
    options.flag("quiet", "only errors", &quiet, 'q');
  }
};

void check_files(const ReportOptions& o) {
  check_target(o.output);
  if (!o.force) need_report(o.output, "give another file, or --force to replace it");
}

void print_page(const ReportOptions& o, const reports::Page& page) {
  if (!check_target(o.output)) return;
  if (page.summary_size() > 0) {
    reports::Summary summary;
    *summary.mutable_rows() = page.summary();
    print_report(o.format, summary, summary_table(summary));
  }
  if (o.format != "table") return;
  std::cout << "report: " << o.output.string() << " (" << page.experiments_size()
            << " experiments, " << page.runs_size()
            << " runs, lists of loops: " << page.loops_size() << ")\n";
}

int run_report(ReportOptions& o, const Options& options) {
  check_files(o);
  o.page.command = shell_command("revisit report", options.arguments());
  const reports::Page page = write_report(o.folders, o.output, o.page);
  if (!o.quiet) print_page(o, page);
  return kOk;
}

}  // namespace

Command report_command() {
  return {"report", "one HTML file of runs, loops and matches; mean and deviation",
          "Writes one HTML file, usable offline, from folders of `revisit eval`: interactive "
          "precision-recall curves, maps, range images of selected queries, perturbed queries, "
          "times, and the command for each number. Figures can be saved as pictures. Prints mean "
          "and sample standard deviation of the metrics of runs with the same settings, such as "
          "the seeds of a simulated drive. Of files of `revisit loops --all --format jsonl` it "
          "shows the map of loops; of .csv files of your own matches (columns score and correct; "
          "perhaps positive and ignored) curve and metrics.",
          "  revisit report results/town_05/latest -o report.html\n"
          "  revisit report results/town*/latest                  # a table of mean and deviation\n"
          "  revisit report results/paper -o report.html          # all experiments below\n"
          "  revisit report rings.csv scan_context.csv            # your own matches\n"
          "  revisit report loops.jsonl -o loops.html\n",
          with_options<ReportOptions>(run_report)};
}

}  // namespace revisit::cli
