#include "eval/plan.h"

#include "cli/json.h"
#include "cli/net_options.h"
#include "cli/terminal.h"
#include "models/models.h"
#include "reports.pb.h"
#include "revisit/base/text.h"
#include "small_drive.h"
#include "testing.h"

namespace revisit {
namespace {

class PlanOption : public testing::Test {
 protected:
  PlanOption() {
    write_small_drive(dir_ / "drive", 240);  // Table 1 stores the first 200 scans
    // KITTI's 00 with only its first scans.
    const fs::path poses = dir_ / "drive/poses/00.txt";
    std::string lines = read_file(poses);
    for (int frame = 240; frame < 4541; ++frame) lines += "1 0 0 0 0 1 0 0 0 0 1 0\n";
    write_file(poses, lines);
    fs::create_directory(dir_ / "models");
  }
  fs::path out() const { return dir_ / "out"; }
  std::string command(const std::string& names, const std::string& more = "") const {
    return "eval " + (dir_ / "drive").string() + " --plan " + names + " --model " +
           (dir_ / "models").string() + " --geometry width=100 -o " + out().string() + " " + more;
  }
  reports::Experiment read(const std::string& name) const {
    reports::Experiment experiment;
    cli::read_report(out() / name / "experiment.json", &experiment);
    return experiment;
  }
  fs::path scan(int frame) const {
    return dir_ / str("drive/sequences/00/velodyne/00000", frame, ".bin");
  }

  const TempDir dir_;
};

TEST_F(PlanOption, ListNamesAllNine) {
  const auto result = run_ok("eval --plan list");
  EXPECT_EQ(cli::paper_experiments().size(), 9);
  for (const auto& experiment : cli::paper_experiments()) EXPECT_HAS(result.out, experiment.name());
}

TEST_F(PlanOption, SkipsRunsWithMissingData) {
  const auto result = run_ok(command("paper"));
  EXPECT_HAS(result.out, "network vgg_cnn_s: no weights");
  for (const auto& experiment : cli::paper_experiments())
    EXPECT_EQ(read(experiment.name()).title(), experiment.title());

  const reports::Experiment networks = read("networks-and-layers");
  ASSERT_EQ(networks.runs_size(), 3);  // `data` on 00, 05, 06
  const reports::ExperimentRun& done = networks.runs(0);
  EXPECT_EQ(done.state(), "done") << done.reason();
  EXPECT_EQ(done.panel(), "00");
  EXPECT_EQ(done.label(), "data");
  EXPECT_EQ(done.feature_dimension(), 100 * 112);
  EXPECT_EQ(done.metrics().protocol(), "paper-median");
  EXPECT_EQ(done.metrics().n_queries(), 40);
  EXPECT_GT(done.frames_per_second(), 0);
  const fs::path run = out() / "networks-and-layers" / done.folder();
  EXPECT_TRUE(fs::exists(run / "scans.csv")) << run;
  EXPECT_FALSE(fs::exists(run / "report.html")) << "one page has all runs";
  EXPECT_HAS(read_file(out() / "report.html"), "Comparison with other methods");
  EXPECT_EQ(networks.runs(1).state(), "skipped");
  EXPECT_HAS(networks.runs(1).reason(), "sequences/05");

  // The listed command reproduces the metric.
  const auto again = run_ok(done.command().substr(8) + " --no-report --format json -o " +
                            (dir_ / "again").string());
  const auto tasks_in = [](const fs::path& folder) {
    reports::Run read;
    cli::read_report(folder / "run.json", &read);
    return cli::to_json(read.tasks(0));
  };
  EXPECT_EQ(tasks_in(dir_ / "again/drive_00/latest"), tasks_in(run));

  // Experiments share runs, and a second call has nothing to do.
  const reports::Experiment comparison = read("comparison");
  std::map<std::string, const reports::ExperimentRun*> on_00;
  for (const reports::ExperimentRun& r : comparison.runs())
    if (r.panel() == "00") on_00[r.feature()] = &r;
  EXPECT_EQ(on_00.at("data")->folder(), done.folder());
  EXPECT_EQ(on_00.at("scan-context")->state(), "done") << on_00.at("scan-context")->reason();
  EXPECT_EQ(on_00.at("m2dp")->feature_dimension(), 192);
  EXPECT_EQ(on_00.at("fabmap")->state(), "skipped");
  EXPECT_HAS(on_00.at("fabmap")->reason(), "image_0");
  const auto second = run_revisit(command("networks-and-layers"));
  EXPECT_EQ(second.err.find("run: "), std::string::npos) << second.err;
  EXPECT_EQ(cli::to_json(read("networks-and-layers").runs(0)), cli::to_json(done));
}

TEST_F(PlanOption, ARunIsRepeatedWhenAScanHasChanged) {
  run_ok(command("networks-and-layers", "--no-report"));
  EXPECT_FALSE(fs::exists(out() / "report.html"));
  const std::string bytes = read_file(scan(7)), run_anew = "run: revisit eval ";
  write_file(scan(7), bytes.substr(0, bytes.size() - 16));
  expect_exit(0, {run_anew}, command("networks-and-layers"));
  // Folder names are hashes: on a collision, the run of the other key is not used.
  const auto folder_of_run = [&] {
    const fs::path run =
        out() / "networks-and-layers" / read("networks-and-layers").runs(0).folder();
    return run.parent_path().parent_path();
  };
  const fs::path changed = folder_of_run();
  write_file(scan(7), bytes);
  run_ok(command("networks-and-layers", "--no-report"));
  const fs::path original = folder_of_run();
  fs::remove_all(original);
  fs::rename(changed, original);
  expect_exit(0, {run_anew}, command("networks-and-layers", "--no-report"));
}

TEST_F(PlanOption, ABrokenScanIsLeftOut) {
  write_file(scan(7), "short");
  expect_exit(0, {"000007.bin"}, command("networks-and-layers"));
  EXPECT_EQ(read("networks-and-layers").runs(0).metrics().n_skipped(), 1);
}

TEST_F(PlanOption, OnlyBrokenScansFailTheRunAndTheExitCode) {
  for (const auto& scan : fs::directory_iterator(dir_ / "drive/sequences/00/velodyne"))
    write_file(scan.path(), "short");
  const auto result = run_revisit(command("networks-and-layers"));
  EXPECT_EQ(result.exit_code, 1);
  EXPECT_HAS(result.out, "000000.bin");
  EXPECT_EQ(read("networks-and-layers").runs(0).state(), "failed");
}

TEST_F(PlanOption, Misuse) {
  expect_exit(2, {"did you mean 'alignment'"}, command("alignmend"));
  EXPECT_EQ(run_revisit("eval /nowhere --plan paper -o " + out().string()).exit_code, 3);
  for (const char* bad :
       {"--model /nowhere", "--threads -1", "--geometry width=-5", "--geometry width=1000000000",
        "--every 0", "--pca 3", "--perturb none"}) {
    expect_exit(2, {}, command("paper", bad));
    EXPECT_FALSE(fs::exists(out())) << bad;
  }
}

TEST_F(PlanOption, APlanMayBeAFile) {
  write_file(dir_ / "plan.txtpb",
             "experiment { name: 'mine' title: 'Mine' sequences: '00' options: '--radius 2' "
             "curve { label: 'a' feature: 'scan-context' } }");
  run_ok(command((dir_ / "plan.txtpb").string(), "--no-report"));
  EXPECT_EQ(read("mine").runs(0).metrics().protocol(), "driving-order")
      << read("mine").runs(0).reason();
  const auto again = run_revisit(command((dir_ / "plan.txtpb").string(), "--no-report"));
  EXPECT_EQ(again.err.find("run: "), std::string::npos) << again.err;
  write_file(dir_ / "plan.txtpb", "experiments { }");
  EXPECT_EQ(run_revisit(command((dir_ / "plan.txtpb").string())).exit_code, 3);
}

TEST_F(PlanOption, AFileThatIsNoReportIsNotReplaced) {
  write_file(out() / "report.html", "my thesis");
  expect_exit(2, {"--no-report"}, command("networks-and-layers"));
}

TEST_F(PlanOption, TheFolderOfFetchedModelsIsNotTheOneAskedFor) {
  run_ok(command("networks-and-layers"), "REVISIT_MODELS=/nowhere");
}

TEST_F(PlanOption, PlacesNeedNoDrivesAndHaveTheWidthAskedFor) {
  models::write_random_model(dir_ / "models", {.prototxt = "alexnet"});
  for (int place = 0; place < 3; ++place)
    for (int copy = 0; copy < 11; ++copy) {
      const fs::path folder = dir_ / "places/objects" / std::to_string(place);
      fs::create_directories(folder);
      fs::copy_file(scan(place), folder / str(copy, ".bin"));
    }
  run_ok("eval " + (dir_ / "places").string() + " --plan hkust-objects,easy-vs-median" +
         " --model " + (dir_ / "models").string() + " --geometry width=100 -o " + out().string());
  const reports::Experiment objects = read("hkust-objects");
  ASSERT_EQ(objects.runs_size(), 3);
  for (const reports::ExperimentRun& run : objects.runs()) {
    EXPECT_EQ(run.state(), "done") << run.reason();
    EXPECT_HAS(run.command(), " --geometry width=100 ");
  }
  EXPECT_EQ(read("easy-vs-median").runs(0).state(), "skipped");
}

models::FoundModel network(const std::string& name, bool trained) {
  models::FoundModel model;
  model.name = name;
  model.prototxt = name + ".prototxt";
  model.weights = name + ".caffemodel";
  model.cut = "p5";
  model.trained = trained;
  return model;
}

struct Planned {
  Planned(const std::string& name, const std::vector<models::FoundModel>& networks) {
    cli::EvalOptions options;
    options.feature.data = "kitti";
    options.feature.image.given["width"] = 900;
    options.output = "out";
    for (const auto& experiment : cli::paper_experiments())
      if (experiment.name() == name) report = experiment;
    cli::plan_experiment(options, networks, &report, &runs);
  }
  std::string labels(const std::string& panel) const {
    std::string text;
    for (const reports::ExperimentRun& run : report.runs())
      if (run.panel() == panel) text += run.label() + "; ";
    return text;
  }
  reports::Experiment report;
  cli::PlannedRuns runs;
};

TEST(ExperimentPlan, ClaimsAreThePapersForEachNetwork) {
  const Planned planned("comparison", {network("a", true), network("b", true)});
  for (const int run : {0, 1}) {
    EXPECT_EQ(planned.report.runs(run).label(), run ? "b p5, proposed" : "a p5, proposed");
    const auto& worse = planned.report.runs(run).better_than();
    EXPECT_EQ(std::vector<std::string>(worse.begin(), worse.end()),
              (std::vector<std::string>{"range image (data)", "VFH", "ESF", "GRSD", "FAB-MAP"}));
  }
  EXPECT_TRUE(planned.report.runs(2).better_than().empty());
}

void add_run(reports::Experiment& experiment, const char* label, double average_precision,
             double low, double high) {
  reports::ExperimentRun& run = *experiment.add_runs();
  run.set_panel("00");
  run.set_label(label);
  run.set_state("done");
  run.set_trained(true);
  run.mutable_metrics()->set_average_precision(average_precision);
  run.mutable_metrics()->add_average_precision_ci(low);
  run.mutable_metrics()->add_average_precision_ci(high);
}

TEST(ExperimentClaims, AreUndecidedWithinTheIntervalsOfEachOther) {
  reports::Experiment experiment;
  add_run(experiment, "a", 0.507, 0.03, 1);
  add_run(experiment, "b", 0.55, 0, 1);
  add_run(experiment, "c", 0.2, 0.1, 0.52);  // excludes b's value
  using Claim = std::pair<bool, bool>;       // holds, undecided
  const auto verdict = [&](int better, const char* worse, std::optional<double> slack = {}) {
    reports::Experiment claimed = experiment;
    reports::ExperimentRun& run = *claimed.mutable_runs(better);
    run.add_better_than(worse);
    if (slack) run.set_slack(*slack);
    cli::check_claims(&claimed);
    return Claim(claimed.claims(0).holds(), claimed.claims(0).undecided());
  };
  EXPECT_EQ(verdict(0, "b"), Claim(false, true));
  EXPECT_EQ(verdict(1, "a"), Claim(true, true));
  EXPECT_EQ(verdict(1, "c"), Claim(true, false));
  EXPECT_EQ(verdict(2, "b"), Claim(false, false));
  // Within the slack, the claim is only that both are equally good.
  EXPECT_EQ(verdict(0, "b", 0.1), Claim(true, false));
  EXPECT_EQ(verdict(0, "b", 0.01), Claim(false, true));
}

TEST(ExperimentPlan, ALayerTablesCurvesAreNamedAfterTheirLayersOthersAfterTheirNetworks) {
  const std::vector<models::FoundModel> networks = {network("bvlc_alexnet", true),
                                                    network("b", true), network("r", false)};
  const Planned layers("networks-and-layers", networks);
  EXPECT_EQ(layers.labels("05"),
            "bvlc_alexnet conv3+pool5; bvlc_alexnet conv4+pool5; bvlc_alexnet pool5; b p5; "
            "r p5 (UNTRAINED); data; ");
  EXPECT_EQ(layers.report.runs(0).better_than(0), "data");
  const Planned alignment("alignment", networks);
  EXPECT_EQ(alignment.labels("05"),
            "bvlc_alexnet p5, aligned; bvlc_alexnet p5, not aligned; "
            "b p5, aligned; b p5, not aligned; data, aligned; data, not aligned; ");
  EXPECT_EQ(alignment.report.runs(0).better_than(0), "bvlc_alexnet p5, not aligned");
  EXPECT_EQ(alignment.report.runs(2).better_than(0), "b p5, not aligned");
  const auto not_aligned = std::ranges::find(alignment.runs, &alignment.report.runs(1),
                                             &cli::PlannedRuns::value_type::second);
  ASSERT_NE(not_aligned, alignment.runs.end());
  EXPECT_EQ(
      joined(not_aligned->first, " "),
      "kitti --sequence 00 --every 1 --sensor hdl64 --geometry width=900 --feature cnn --model "
      "bvlc_alexnet.prototxt --weights bvlc_alexnet.caffemodel --end p5 --align none "
      "--protocol paper-median --cache out/cache --threads 0");
  EXPECT_EQ(Planned("hkust-rotation", networks).runs.size(), 18U)
      << "of each network three ways of three parts";
}

TEST_F(PlanOption, NothingToRunIsAnError) {
  expect_exit(3, {"--plan bidirectional: nothing was run"}, command("bidirectional"));
  EXPECT_TRUE(fs::exists(out() / "report.html"));
}

TEST_F(PlanOption, SkippedRunsHaveOneLineAndNoEmptyTable) {
  std::ofstream(dir_ / "drive/sequences/00/simulation.txt") << "version: 1\nroute: loop\n";
  const auto result = run_ok(command("alignment,bidirectional"));
  EXPECT_HAS(result.out, "Simulated drives");
  // bidirectional needs a network, and there is none: no header without rows.
  const std::string nothing = result.out.substr(result.out.find("Revisits in the opposite"));
  EXPECT_EQ(nothing.find("sequence  curve"), std::string::npos) << result.out;
  EXPECT_HAS(result.out, "): 05 data, aligned; 05 data, not aligned.");
}

}  // namespace
}  // namespace revisit
