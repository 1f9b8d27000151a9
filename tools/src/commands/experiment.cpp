#include "experiment/experiment.h"

#include <algorithm>
#include <iostream>
#include <list>

#include "cli/command.h"
#include "cli/json.h"
#include "cli/options.h"
#include "cli/shell.h"
#include "cli/table.h"
#include "models/all_models.h"
#include "report/markdown.h"
#include "report/page.h"

namespace revisit::cli {
namespace {

namespace fs = std::filesystem;

std::vector<std::string> experiment_names() {
  std::vector<std::string> names = {"all", "list"};
  for (const reports::PlannedExperiment& experiment : paper_experiments())
    names.push_back(experiment.report().name());
  return names;
}

/// Checks options that all runs share, because in a run an error would only skip it.
void check(const ExperimentOptions& options) {
  const FeatureOptions& feature = options.feature;
  const std::vector<std::string> known = experiment_names();
  for (const std::string& name : options.names)
    if (std::ranges::count(known, name) == 0)
      throw UsageError("unknown experiment '", name, "'", nearest_name_hint(name, known),
                       "; 'revisit experiment list' shows them all");
  if (feature.data.empty() && options.hkust.empty())
    throw UsageError("missing required option --kitti DIR or --hkust DIR");
  if (options.hkust.empty() && !fs::is_directory(feature.data / "sequences"))
    throw InputError(feature.data.string(), ": no folder sequences/ (--kitti)");
  feature.image.geometry();
}

int run_experiments(const ExperimentOptions& options, const Options& rows) {
  if (options.names == std::vector<std::string>{"list"}) {
    Table table({"experiment", "comparison"});
    for (const reports::PlannedExperiment& experiment : paper_experiments())
      table.row({experiment.report().name(), experiment.report().question()});
    table.print(std::cout);
    return kOk;
  }
  check(options);
  PageOptions page;
  page.command = shell_command("revisit experiment", rows.arguments());
  const fs::path file = options.output / "report.html";
  if (!options.no_report) need_report(file, kHtmlMark, "move it away, or give --no-report");

  const std::vector<models::FoundModel> networks = models::all_models(options.models);
  std::list<reports::Experiment> reports;
  Runs runs;
  for (const reports::PlannedExperiment& experiment : paper_experiments())
    if (std::ranges::count(options.names, experiment.report().name()) +
        std::ranges::count(options.names, "all"))
      plan_experiment(experiment, options, networks, &reports.emplace_back(), &runs);
  carry_out(options, runs);
  bool good = true;
  for (reports::Experiment& report : reports) {
    report.set_command(page.command);
    check_claims(&report);
    write_json(options.output / report.name() / "experiment.json", report);
    print_experiment(report, std::cout);
    good &= std::ranges::count(report.runs(), "failed", &reports::ExperimentRun::state) == 0;
  }
  std::cout << "\nresults: " << options.output.string() << "\n";
  if (!options.no_report) {
    write_report({options.output}, file, page);
    std::cout << "report: " << file.string() << "\n";
  }
  return good ? kOk : kFailed;
}

}  // namespace

void ExperimentOptions::declare(Options& options) {
  options.argument("NAME", &names).suggest(experiment_names());
  options.option("kitti", "DIR", "KITTI odometry, or drives of `revisit simulate`", &feature.data);
  options.option("models", "DIR",
                 "folder of networks, also below it; repeatable (default: the fetched models)",
                 &models);
  options.option("hkust", "DIR", "sets of places: DIR/rotation and DIR/objects", &hkust);
  options.option("every", "N", "frame stride (default 1)", &feature.every).at_least(1);
  options.option("geometry", "of the range image, e.g. width=2000", {"width", "height"},
                 &feature.image.given);
  options.option("output", "DIR", "folder of the experiments", &output, 'o').required();
  options.flag("no-report", "no report.html in the folder of the experiments", &no_report);
  options.option("threads", "N", "threads (default: all cores)", &feature.threads).at_least(0);
  options.flag("quiet", "only results and errors", &feature.quiet, 'q');
}

Command experiment_command() {
  return {
      "experiment", "the experiments of the paper",
      "Runs the experiments of the paper, on KITTI odometry or on simulated drives (sequences 00, "
      "05, 06, 08). Finished runs are kept: if interrupted, run the same command again to resume. "
      "Runs without their data or model are listed and skipped. A statement of the paper holds, "
      "fails, or is undecided, if each of the two values lies within the other's 95 % interval.",
      "  revisit experiment list\n"
      "  revisit experiment all --kitti KITTI --models MODELS -o results/paper\n"
      "  revisit experiment alignment score --kitti town --every 4 -o results/town\n"
      "  revisit report results/paper -o report.html     # only the page\n",
      with_options<ExperimentOptions>(run_experiments)};
}

}  // namespace revisit::cli
