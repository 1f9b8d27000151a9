#include <algorithm>
#include <iostream>
#include <map>

#include "cli/command.h"
#include "cli/parser.h"
#include "cli/shell.h"
#include "cli/table.h"
#include "eval/feature_options.h"
#include "experiment/run_experiments.h"
#include "report/page.h"
#include "revisit/base/joined.h"

namespace revisit::cli {
namespace {

namespace fs = std::filesystem;

ExperimentOptions parse_experiment_options(const Arguments& arguments) {
  ExperimentOptions o;
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
  std::vector<std::string> names = {"all", "list"};
  for (const ExperimentInfo& info : experiments()) names.push_back(info.name);
  parser.optional_positional("NAME", &o.names).suggest(names);
  parser.group("Data:");
  parser.option("kitti", "DIR",
                "KITTI odometry, or drives that `revisit simulate` wrote (not needed with --hkust)",
                &o.kitti);
  parser.option("models", "DIR",
                "folder of networks (.caffemodel with its prototxt, in sub-folders, too); may be "
                "repeated (default: the fetched models, in $REVISIT_MODELS or "
                "~/.cache/revisit/models)",
                &o.models);
  parser.option("hkust", "DIR", "sets of places: DIR/rotation and DIR/objects", &o.hkust);
  parser.option("every", "N", "only frames whose number is a multiple of N (default 1: all)",
                &o.every);
  parser.option("sensor", "NAME", "geometry of the range image (default hdl64)", &o.sensor)
      .suggest(sensor_names());
  parser.option("width", "PIXELS", "columns of the range image (default: the sensor's, 4000)",
                &o.width);
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
                &o.threads);
  parser.flag("keep-features",
              "keep the features of whole scans (some GB per network and sequence) when their runs "
              "are done; the descriptors are kept in any case",
              &o.keep_features);
  parser.flag("no-progress", "no progress line", &o.no_progress);
  parser.flag("quiet", "only results and errors", &o.quiet, 'q');
  parser.parse(arguments);
  return o;
}

/// What every run shares is judged once, here: in a run it would only be a reason to leave it out.
void check(const ExperimentOptions& options) {
  if (options.kitti.empty() && !options.hkust)
    throw UsageError("give the data set: --kitti DIR, --hkust DIR or both");
  if (options.output.empty()) throw UsageError("give the folder of the results: -o DIR");
  if (!(options.feature_mb > 0))
    throw UsageError(str("--feature-mb: expected a positive number, found ", options.feature_mb));
  FeatureOptions shared;
  shared.image.sensor = options.sensor;
  if (options.width) shared.image.width = options.width;
  shared.threads = options.threads;
  shared.image.geometry();
  shared.thread_count();
}

void print_list() {
  Table table({"experiment", "what is compared"});
  for (const ExperimentInfo& info : experiments()) table.row({info.name, info.question});
  table.print(std::cout);
}

void print_results(const std::vector<reports::Experiment>& all) {
  for (const reports::Experiment& experiment : all) {
    Table table({"sequence", "curve", "AP", "95 %", "F1 max", "recall@100%P", "recall@1"});
    bool any = false;
    for (const reports::ExperimentRun& run : experiment.runs()) {
      if (run.state() != "done") continue;
      any = true;
      const reports::Metrics& m = run.metrics();
      table.row({run.panel(), run.label(),
                 m.has_average_precision() ? number(m.average_precision(), 4) : "",
                 m.average_precision_ci_size() == 2 ? number(m.average_precision_ci(0), 3) + "-" +
                                                          number(m.average_precision_ci(1), 3)
                                                    : "",
                 m.has_f1_max() ? number(m.f1_max(), 4) : "",
                 m.has_max_recall_at_precision_1() ? number(m.max_recall_at_precision_1(), 4) : "",
                 m.has_recall_at_1() ? number(m.recall_at_1(), 4) : ""});
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
}

/// What ran and what did not, a row for each experiment and state. True when nothing failed.
bool print_summary(const std::vector<reports::Experiment>& all) {
  bool good = true;
  Table table({"experiment", "runs", "state", "why"});
  for (const reports::Experiment& experiment : all) {
    struct Kind {
      int runs = 0;
      std::vector<std::string> reasons;
    };
    std::map<std::string, Kind> kinds;  // by state
    for (const reports::ExperimentRun& run : experiment.runs()) {
      Kind& kind = kinds[run.state()];
      ++kind.runs;
      if (std::find(kind.reasons.begin(), kind.reasons.end(), run.reason()) == kind.reasons.end())
        kind.reasons.push_back(run.reason());
    }
    if (kinds.empty()) table.row({experiment.name(), "0", "skipped", "no network was found"});
    for (const auto& [state, kind] : kinds) {
      table.row({experiment.name(), str(kind.runs), state, joined(kind.reasons, "; ")});
      good &= state != "failed";
    }
  }
  std::cout << "\n";
  table.print(std::cout);
  return good;
}

}  // namespace

int experiment_command(const Arguments& arguments) {
  ExperimentOptions options = parse_experiment_options(arguments);
  if (options.names.empty())
    throw UsageError("which experiment? Give a name, several, or all; 'revisit experiment list'");
  if (options.names == std::vector<std::string>{"list"}) {
    print_list();
    return kOk;
  }
  for (const std::string& name : options.names)
    if (name != "all") find_experiment(name);
  check(options);
  const fs::path report = options.output / "report.html";
  if (!options.no_report) need_report(report, kHtmlMark, "move it away, or give --no-report");

  const Inventory inventory = take_inventory(options);
  if (!options.quiet)
    for (const std::string& missing : inventory.missing)
      std::cerr << "missing: " << missing << "\n";
  if (!options.quiet)
    for (const std::string& passed : inventory.passed_over)
      std::cerr << "passed over: " << passed << "\n";
  PageOptions page;
  page.command = shell_command("revisit experiment", arguments);
  const std::vector<reports::Experiment> results =
      run_experiments(options, inventory, make_plans(options, inventory), page.command);
  print_results(results);
  const bool good = print_summary(results);
  std::cout << "\nresults: " << options.output.string() << "\n";
  if (!options.no_report) {
    write_report({options.output}, report, page);
    std::cout << "report: " << report.string() << "\n";
  }
  return good ? kOk : kFailed;
}

}  // namespace revisit::cli
