#include "experiment/experiment.h"

#include <algorithm>
#include <iostream>
#include <map>

#include "cli/command.h"
#include "cli/parser.h"
#include "cli/shell.h"
#include "cli/table.h"
#include "eval/feature_options.h"
#include "report/page.h"
#include "revisit/base/joined.h"

namespace revisit::cli {
namespace {

namespace fs = std::filesystem;

std::vector<std::string> names() {
  std::vector<std::string> names = {"all", "list"};
  for (const reports::PlannedExperiment& experiment : experiment_table().experiment())
    names.push_back(experiment.report().name());
  return names;
}

ExperimentOptions parse_experiment_options(const Arguments& arguments) {
  ExperimentOptions o;
  o.shared.image.sensor = "hdl64";
  Parser parser(
      "revisit experiment", "NAME... | all | list",
      "The experiments of the paper, on KITTI odometry or on simulated drives (sequences "
      "00, 05, 06, 08). Work is shared between experiments and kept: run the same command again to "
      "continue a stopped one. Experiments whose networks or sequences are missing are listed, the "
      "rest runs. Each statement of the paper holds, does not, or is "
      "undecided: each of the two figures lies within the other's 95 % interval.",
      "  revisit experiment list\n"
      "  revisit experiment all --kitti KITTI --models MODELS -o results/paper\n"
      "  revisit experiment alignment score --kitti town --every 4 -o results/town\n"
      "  revisit report results/paper -o report.html     # the page alone, again\n");
  parser.optional_positional("NAME", &o.names).suggest(names());
  parser.group("Data:");
  parser.option("kitti", "DIR",
                "KITTI odometry, or drives that `revisit simulate` wrote (not needed with --hkust)",
                &o.shared.data);
  parser.option("models", "DIR",
                "folder of networks (.caffemodel with its prototxt, in sub-folders, too); may be "
                "repeated (default: the fetched models, in $REVISIT_MODELS or "
                "~/.cache/revisit/models)",
                &o.models);
  parser.option("hkust", "DIR", "sets of places: DIR/rotation and DIR/objects", &o.hkust);
  parser.option("every", "N", "only frames whose number is a multiple of N (default 1: all)",
                &o.shared.every);
  parser
      .option("sensor", "NAME", "geometry of the range image (default hdl64)",
              &o.shared.image.sensor)
      .suggest(sensor_names());
  parser.option("width", "PIXELS", "columns of the range image (default: the sensor's, 4000)",
                &o.shared.image.width);
  parser.option("feature-mb", "MB",
                "layers whose feature is larger are left out (default 8 MB per scan)",
                &o.feature_mb);
  parser.flag("untrained",
              "random weights for the paper's networks that are missing, on the smallest sequence: "
              "shows that they run, proves nothing about accuracy",
              &o.untrained);
  parser.group("Running:");
  parser.option("output", "DIR", "folder of the experiments, kept between calls", &o.output, 'o');
  parser.flag("no-report", "no report.html in the folder of the experiments", &o.no_report);
  parser.option("threads", "N", "scans in flight, one thread each (default: all cores)",
                &o.shared.threads);
  parser.flag("keep-features",
              "keep the features of whole scans (some GB per network and sequence) when their runs "
              "are done; the descriptors are kept in any case",
              &o.keep_features);
  parser.flag("no-progress", "no progress line", &o.shared.no_progress);
  parser.flag("quiet", "only results and errors", &o.shared.quiet, 'q');
  parser.parse(arguments);
  return o;
}

/// Checks before any run what all share: in a run it would only be a reason to leave it out.
void check(const ExperimentOptions& options) {
  const std::vector<std::string> known = names();
  for (const std::string& name : options.names)
    if (std::ranges::count(known, name) == 0)
      throw UsageError(str("unknown experiment '", name, "'", did_you_mean(name, known),
                           "; 'revisit experiment list' shows them all"));
  if (options.shared.data.empty() && !options.hkust)
    throw UsageError("give the data set: --kitti DIR, --hkust DIR or both");
  if (options.output.empty()) throw UsageError("give the folder of the results: -o DIR");
  if (!(options.feature_mb > 0))
    throw UsageError(str("--feature-mb: expected a positive number, found ", options.feature_mb));
  if (options.shared.every < 1)
    throw UsageError(str("--every: expected at least 1, found ", options.shared.every));
  if (!options.hkust && !fs::is_directory(options.shared.data / "sequences"))
    throw InputError(str(options.shared.data.string(), ": no folder sequences/ (--kitti)"));
  options.shared.image.geometry();
  options.shared.thread_count();
}

void print_list() {
  Table table({"experiment", "what is compared"});
  for (const reports::PlannedExperiment& experiment : experiment_table().experiment())
    table.row({experiment.report().name(), experiment.report().question()});
  table.print(std::cout);
}

void print_results(const reports::Experiment& experiment) {
  Table table({"sequence", "curve", "AP", "95 %", "F1 max", "recall@100%P", "recall@1"});
  bool any = false;
  for (const reports::ExperimentRun& run : experiment.runs()) {
    if (run.state() != "done") continue;
    any = true;
    const reports::Metrics& m = run.metrics();
    const auto& interval = m.average_precision_ci();
    const auto cell = [](bool there, double value) { return there ? number(value, 4) : ""; };
    table.row({run.panel(), run.label(), cell(m.has_average_precision(), m.average_precision()),
               interval.size() == 2 ? number(interval[0], 3) + "-" + number(interval[1], 3) : "",
               cell(m.has_f1_max(), m.f1_max()),
               cell(m.has_max_recall_at_precision_1(), m.max_recall_at_precision_1()),
               cell(m.has_recall_at_1(), m.recall_at_1())});
  }
  std::cout << "\n" << experiment.title() << "\n";
  for (const std::string& note : experiment.notes()) std::cout << "  " << note << "\n";
  if (any)
    table.print(std::cout);
  else
    std::cout << "  None of them could run; the table below says why.\n";
  for (const reports::ExperimentClaim& claim : experiment.claims())
    std::cout << (claim.undecided() ? "  undecided "
                  : claim.holds()   ? "  holds     "
                                    : "  DOES NOT  ")
              << claim.panel() << ": " << claim.text() << " ("
              << number(claim.better_average_precision(), 3) << ", "
              << number(claim.worse_average_precision(), 3) << ")\n";
}

/// Prints a row for each experiment and state of its runs. True when nothing failed.
bool print_summary(const std::vector<reports::Experiment>& all) {
  bool good = true;
  Table table({"experiment", "runs", "state", "why"});
  for (const reports::Experiment& experiment : all) {
    std::map<std::string, std::vector<std::string>> reasons;  // by state, of each run
    for (const reports::ExperimentRun& run : experiment.runs())
      reasons[run.state()].push_back(run.reason());
    if (reasons.empty()) table.row({experiment.name(), "0", "skipped", "no network was found"});
    for (auto& [state, of_runs] : reasons) {
      const std::string runs = str(of_runs.size());
      std::ranges::sort(of_runs);
      of_runs.erase(std::ranges::unique(of_runs).begin(), of_runs.end());
      table.row({experiment.name(), runs, state, joined(of_runs, "; ")});
      good &= state != "failed";
    }
  }
  std::cout << "\n";
  table.print(std::cout);
  return good;
}

}  // namespace

int experiment_command(const Arguments& arguments) {
  const ExperimentOptions options = parse_experiment_options(arguments);
  if (options.names.empty())
    throw UsageError("which experiment? Give a name, several, or all; 'revisit experiment list'");
  if (options.names == std::vector<std::string>{"list"}) {
    print_list();
    return kOk;
  }
  check(options);
  PageOptions page;
  page.command = shell_command("revisit experiment", arguments);
  const fs::path file = options.output / "report.html";
  if (!options.no_report) need_report(file, kHtmlMark, "move it away, or give --no-report");

  const Networks networks = find_networks(options);
  if (!options.shared.quiet) {
    for (const std::string& missing : networks.missing) std::cerr << "missing: " << missing << "\n";
    for (const std::string& passed : networks.passed_over)
      std::cerr << "passed over: " << passed << "\n";
  }
  const std::vector<reports::Experiment> reports =
      run_plans(options, make_plans(options, networks), page.command);
  for (const reports::Experiment& report : reports) print_results(report);
  const bool good = print_summary(reports);
  std::cout << "\nresults: " << options.output.string() << "\n";
  if (!options.no_report) {
    write_report({options.output}, file, page);
    std::cout << "report: " << file.string() << "\n";
  }
  return good ? kOk : kFailed;
}

}  // namespace revisit::cli
