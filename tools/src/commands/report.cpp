#include <fstream>
#include <iostream>
#include <sstream>

#include "cli/command.h"
#include "cli/messages.h"
#include "cli/parser.h"
#include "cli/shell.h"
#include "report/html.h"
#include "report/markdown.h"
#include "report/page.h"
#include "revisit/proto/atomic_file.h"

namespace revisit::cli {
namespace {

namespace fs = std::filesystem;

/// A file that is there is replaced when it is an earlier report, which has `mark` in it. Another
/// one may be somebody's work.
void need_ours(const fs::path& file, const std::string& mark) {
  std::error_code none;
  if (!fs::is_regular_file(file, none) || fs::is_empty(file, none)) return;
  std::ostringstream content;
  content << std::ifstream(file, std::ios::binary).rdbuf();
  if (content.str().find(mark) == std::string::npos)
    throw UsageError(str(file.string(), ": is there, and not by `revisit report`; choose another ",
                         "file, or replace it with --force"));
}

}  // namespace

int report_command(const Arguments& arguments) {
  std::vector<fs::path> folders;
  fs::path output = "report.html";
  std::optional<fs::path> markdown;
  PageOptions options;
  options.title = "Place recognition";
  bool quiet = false, force = false;
  Parser parser("revisit report", "RUN_OR_EXPERIMENT...",
                "One HTML file that opens offline, from the folders that `revisit eval` and "
                "`revisit experiment` wrote: interactive precision-recall curves, maps, range "
                "images of the queries worth looking at, times, and the command beside each "
                "number. The figures are written beside it, too (report_files/, SVG and PNG).",
                "  revisit report results/town_05/latest -o report.html\n"
                "  revisit report results/paper -o report.html   # all experiments below\n");
  parser.positional("FOLDER", &folders);
  parser.group("Output:");
  parser.option("page", "FILE", "the HTML file (default report.html)", &output, 'o');
  parser.option("markdown", "FILE",
                "also the tables and figures of the experiments as Markdown, e.g. docs/RESULTS.md",
                &markdown);
  parser.option("title", "TEXT", "of the page (default Place recognition)", &options.title);
  parser.option("queries", "N",
                "shown with range images, of each kind: wrong, missed, right "
                "(default 3)",
                &options.queries);
  parser.option("image-mb", "MB", "most that range images take in the file (default 12)",
                &options.image_mb);
  parser.flag("no-plots", "no SVG and PNG figures beside the file", &options.no_plots);
  parser.flag("force", "replace files that are no reports", &force);
  parser.flag("quiet", "only errors", &quiet, 'q');
  parser.parse(arguments);
  if (options.queries < 0)
    throw UsageError(str("--queries: expected at least 0, found ", options.queries));
  if (!(options.image_mb >= 0 && options.image_mb <= 500))
    throw UsageError(str("--image-mb: expected 0 to 500, found ", options.image_mb));

  const bool streams = writing_of(output) == Writing::kStreams;
  if (markdown) {
    writing_of(*markdown);
    if (fs::weakly_canonical(*markdown) == fs::weakly_canonical(output))
      throw UsageError(str("--markdown: ", markdown->string(), " is the HTML file of --output"));
    if (!force) need_ours(*markdown, kMarkdownMark);
  }
  if (!force) need_ours(output, kHtmlMark);

  options.command = shell_command("revisit report", arguments);
  // Beside a file; there is no place beside a pipe or a device.
  options.files = streams ? fs::path("report") : output;
  options.files.replace_extension();
  options.files += "_files";
  options.static_figures = !has_plot_library();
  const ReportData data = read_report_data(folders);
  const reports::Page page = make_page(data, options);
  const std::string html = html_page(page);
  write_atomically(output, [&](std::ostream& out) { out << html; });
  if (markdown) {
    std::error_code ignored;  // what comes of it is said by the writing
    fs::create_directories(fs::absolute(*markdown).parent_path(), ignored);
    write_atomically(*markdown, [&](std::ostream& out) {
      out << results_markdown(data,
                              fs::relative(options.files, fs::absolute(*markdown).parent_path()));
    });
  }
  for (const std::string& warning : page.warnings()) warn(warning);
  if (options.static_figures)
    std::cerr << "note: this build has no plotting library; the figures are static (install "
                 "libjs-chart.js and build again)\n";
  if (!quiet)
    (streams ? std::cerr : std::cout)
        << "report: " << output.string() << " (" << html.size() / 1000 << " kB, "
        << data.experiments.size() << " experiments, " << data.runs.size()
        << " runs)\nfigures: " << options.files.string() << "\n";
  return kOk;
}

}  // namespace revisit::cli
