#include "report/report.h"

#include <chrono>
#include <functional>
#include <iostream>
#include <thread>

#include "cli/command.h"
#include "cli/json.h"
#include "cli/options.h"
#include "cli/shell.h"
#include "cli/terminal.h"
#include "revisit/base/files.h"

namespace revisit::cli {
namespace fs = std::filesystem;
namespace {

/// Calls `make` now and on every change of a size. Ends after `patience` [s] without one.
void while_they_grow(const std::vector<fs::path>& files, double patience,
                     const std::function<void()>& make) {
  using Clock = std::chrono::steady_clock;
  constexpr auto kMoment = std::chrono::milliseconds(500);
  std::vector<uintmax_t> seen;
  for (Clock::time_point last = Clock::now();
       !interrupted() && std::chrono::duration<double>(Clock::now() - last).count() <= patience;
       std::this_thread::sleep_for(kMoment)) {
    std::vector<uintmax_t> sizes;
    for (const fs::path& file : files) {
      std::error_code none;
      sizes.push_back(fs::file_size(file, none));
    }
    if (sizes == seen) continue;
    seen = std::move(sizes);
    make();
    last = Clock::now();
  }
}

struct ReportOptions {
  std::vector<fs::path> folders;
  fs::path output = "report.html";
  std::string format = "table";
  PageOptions page;
  std::optional<double> follow;
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
    options
        .option("follow", "SECONDS",
                "update of the page whenever a file of loops grows, until none grows for this "
                "time; the browser reloads it",
                &follow)
        .positive();
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
  if (o.follow)
    while_they_grow(o.folders, *o.follow, [&] {
      o.page.reloads = true;
      write_report(o.folders, o.output, o.page);
    });
  o.page.reloads = false;
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
          "shows the map of loops, also while the file grows; of .csv files of your own matches "
          "(columns score and correct; perhaps positive and ignored) curve and metrics.",
          "  revisit report results/town_05/latest -o report.html\n"
          "  revisit report results/town*/latest                  # a table of mean and deviation\n"
          "  revisit report results/paper -o report.html          # all experiments below\n"
          "  revisit report rings.csv scan_context.csv            # your own matches\n"
          "  revisit report loops.jsonl --follow 10 -o loops.html\n",
          with_options<ReportOptions>(run_report)};
}

}  // namespace revisit::cli
