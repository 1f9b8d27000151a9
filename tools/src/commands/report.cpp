#include <chrono>
#include <functional>
#include <iostream>
#include <thread>

#include "cli/command.h"
#include "cli/interrupt.h"
#include "cli/parser.h"
#include "cli/shell.h"
#include "report/markdown.h"
#include "report/page.h"
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

}  // namespace

int report_command(const Arguments& arguments) {
  std::vector<fs::path> folders;
  fs::path output = "report.html";
  std::optional<fs::path> markdown;
  PageOptions options;
  std::optional<double> follow;
  bool quiet = false, force = false;
  Parser parser("revisit report", "RUN_OR_EXPERIMENT_OR_LOOPS...",
                "Writes one HTML file, usable offline, from folders of `revisit eval`, `revisit "
                "experiment` and `revisit "
                "robustness`: interactive precision-recall curves, maps, range images of selected "
                "queries, times, and the "
                "command for each number. Figures can be saved as pictures. Tables of robustness "
                "with the same options are "
                "merged. For a file of `revisit loops --all --format jsonl` it shows the map of "
                "loops, also while the file grows.",
                "  revisit report results/town_05/latest -o report.html\n"
                "  revisit report results/paper -o report.html   # all experiments below\n"
                "  revisit report loops.jsonl --follow 10 -o loops.html\n");
  parser.positional("FOLDER", &folders);
  parser.group("Output:");
  parser.option("output", "FILE", "the HTML file (default report.html)", &output, 'o');
  parser.option("markdown", "FILE",
                "file for the tables of the experiments as Markdown (default: none)", &markdown);
  parser.option("title", "TEXT", "title of the page (default Place recognition)", &options.title);
  parser.option("queries", "N",
                "queries with range images, for each of wrong, missed and correct (default 3)",
                &options.queries);
  parser.option("follow", "SECONDS",
                "update of the page whenever a file of loops grows, until none grows for this "
                "time; the browser "
                "reloads it",
                &follow);
  parser.option("image-mb", "MB", "maximum size of all range images (default 12)",
                &options.image_mb);
  parser.flag("force", "replacement of files that are not reports", &force);
  parser.flag("quiet", "only errors", &quiet, 'q');
  parser.parse(arguments);
  if (options.queries < 0)
    throw UsageError("--queries: expected at least 0, found ", options.queries);
  if (!(options.image_mb >= 0 && options.image_mb <= 500))
    throw UsageError("--image-mb: expected 0 to 500, found ", options.image_mb);

  if (follow && !(*follow > 0))
    throw UsageError("--follow: expected a positive number, found ", *follow);

  const bool streams = writing_of(output) == Writing::kStreams;
  const std::string advice = "give another file, or --force to replace it";
  if (markdown) {
    writing_of(*markdown);
    if (fs::weakly_canonical(*markdown) == fs::weakly_canonical(output))
      throw UsageError("--markdown: ", markdown->string(), " is the HTML file of --output");
    if (!force) need_report(*markdown, kMarkdownMark, advice);
  }
  if (!force) need_report(output, kHtmlMark, advice);

  options.command = shell_command("revisit report", arguments);
  if (follow)
    while_they_grow(folders, *follow, [&] {
      options.reloads = true;
      write_report(folders, output, options);
    });
  options.reloads = false;
  const reports::Page page = write_report(folders, output, options);
  if (markdown) {
    std::error_code ignored;  // writing reports the error
    fs::create_directories(fs::absolute(*markdown).parent_path(), ignored);
    write_atomically(*markdown, [&](std::ostream& out) { out << results_markdown(page); });
  }
  if (!quiet)
    (streams ? std::cerr : std::cout)
        << "report: " << output.string() << " (" << page.experiments_size() << " experiments, "
        << page.runs_size() << " runs, lists of loops: " << page.loops_size()
        << ", tables of robustness: " << page.robustness_size() << ")\n";
  return kOk;
}

}  // namespace revisit::cli
