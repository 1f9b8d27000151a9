// `revisit experiment` as a person meets it, on a tiny drive: sequence 00 alone, without networks.
#include "experiment/experiment.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <fstream>
#include <map>

#include "cli/json.h"
#include "eval/curve.h"
#include "reports.pb.h"
#include "revisit/weights_conversion/random_model.h"
#include "small_drive.h"
#include "test_data.h"

namespace revisit {
namespace {

namespace fs = std::filesystem;
using test::run_revisit;

class ExperimentCommand : public testing::Test {
 protected:
  ExperimentCommand() {
    test::write_small_drive(dir_ / "drive", 240);  // Table 1 stores the first 200 scans
    // KITTI's 00 of which only the first scans are there.
    const fs::path poses = dir_ / "drive/poses/00.txt";
    std::string lines = test::read_file(poses);
    for (int frame = 240; frame < 4541; ++frame) lines += "1 0 0 0 0 1 0 0 0 0 1 0\n";
    test::write_file(poses, lines);
    fs::create_directory(dir_ / "models");
  }
  fs::path out() const { return dir_ / "out"; }
  std::string command(const std::string& names, const std::string& more = "") const {
    return "experiment " + names + " --kitti " + (dir_ / "drive").string() + " --models " +
           (dir_ / "models").string() + " --width 100 -o " + out().string() + " " + more;
  }
  reports::Experiment read(const std::string& name) const {
    reports::Experiment experiment;
    cli::read_report(out() / name / "experiment.json", &experiment);
    return experiment;
  }

  const test::TempDir dir_;
};

TEST_F(ExperimentCommand, ListNamesAllNine) {
  const auto result = run_revisit("experiment list");
  ASSERT_EQ(result.exit_code, 0) << result.err;
  EXPECT_EQ(cli::experiment_table().experiment_size(), 9);
  for (const auto& experiment : cli::experiment_table().experiment())
    EXPECT_NE(result.out.find(experiment.report().name()), std::string::npos)
        << experiment.report().name();
}

TEST_F(ExperimentCommand, WhatIsMissingIsSaidAndTheRestRuns) {
  const auto result = run_revisit(command("all"));
  ASSERT_EQ(result.exit_code, 0) << result.err;
  EXPECT_NE(result.err.find("missing: network vgg_cnn_s"), std::string::npos) << result.err;
  for (const auto& experiment : cli::experiment_table().experiment())
    EXPECT_EQ(read(experiment.report().name()).title(), experiment.report().title());

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
  EXPECT_NE(test::read_file(out() / "report.html").find("Comparison with other methods"),
            std::string::npos);
  EXPECT_EQ(networks.runs(1).state(), "skipped");
  EXPECT_NE(networks.runs(1).reason().find("sequences/05"), std::string::npos)
      << networks.runs(1).reason();

  // The command beside a number gives that number.
  const auto again = run_revisit(done.command().substr(8) + " --no-report --format json -o " +
                                 (dir_ / "again").string());
  ASSERT_EQ(again.exit_code, 0) << again.err;
  const auto digits = test::read_file(run / "metrics.json");
  EXPECT_EQ(test::read_file(dir_ / "again/drive_00/latest/metrics.json"), digits);

  // What experiments share is one run, and a second call has nothing to do.
  const reports::Experiment comparison = read("comparison");
  std::map<std::string, const reports::ExperimentRun*> on_00;
  for (const reports::ExperimentRun& r : comparison.runs())
    if (r.panel() == "00") on_00[r.feature()] = &r;
  EXPECT_EQ(on_00.at("data")->folder(), done.folder());
  EXPECT_EQ(on_00.at("scan-context")->state(), "done") << on_00.at("scan-context")->reason();
  EXPECT_EQ(on_00.at("m2dp")->feature_dimension(), 192);
  EXPECT_EQ(on_00.at("fabmap")->state(), "skipped");
  EXPECT_NE(on_00.at("fabmap")->reason().find("image_0"), std::string::npos);
  const auto second = run_revisit(command("networks-and-layers"));
  EXPECT_NE(second.err.find("0 runs to do, 1 done before, 2 cannot run"), std::string::npos)
      << second.err;
}

TEST_F(ExperimentCommand, ARunIsRepeatedWhenAScanHasChanged) {
  ASSERT_EQ(run_revisit(command("networks-and-layers", "--no-report")).exit_code, 0);
  EXPECT_FALSE(fs::exists(out() / "report.html"));
  const fs::path scan = dir_ / "drive/sequences/00/velodyne/000007.bin";
  const std::string bytes = test::read_file(scan);
  test::write_file(scan, bytes.substr(0, bytes.size() - 16));
  const auto again = run_revisit(command("networks-and-layers"));
  EXPECT_NE(again.err.find("1 runs to do, 0 done before"), std::string::npos) << again.err;
}

TEST_F(ExperimentCommand, ABrokenScanIsLeftOut) {
  test::write_file(dir_ / "drive/sequences/00/velodyne/000007.bin", "short");
  const auto result = run_revisit(command("networks-and-layers"));
  EXPECT_EQ(result.exit_code, 0);
  EXPECT_NE(result.err.find("000007.bin"), std::string::npos) << result.err;
  EXPECT_EQ(read("networks-and-layers").runs(0).metrics().n_left_out(), 1);
}

TEST_F(ExperimentCommand, OnlyBrokenScansFailTheRunAndTheExitCode) {
  for (const auto& scan : fs::directory_iterator(dir_ / "drive/sequences/00/velodyne"))
    test::write_file(scan.path(), "short");
  const auto result = run_revisit(command("networks-and-layers"));
  EXPECT_EQ(result.exit_code, 1);
  EXPECT_NE(result.out.find("000000.bin"), std::string::npos) << result.out;
  EXPECT_EQ(read("networks-and-layers").runs(0).state(), "failed");
}

TEST_F(ExperimentCommand, Misuse) {
  EXPECT_EQ(run_revisit("experiment").exit_code, 2);
  const auto unknown = run_revisit(command("alignmend"));
  EXPECT_EQ(unknown.exit_code, 2);
  EXPECT_NE(unknown.err.find("did you mean 'alignment'"), std::string::npos) << unknown.err;
  EXPECT_EQ(run_revisit("experiment all -o " + out().string()).exit_code, 2);
  EXPECT_EQ(run_revisit("experiment all --kitti /nowhere -o " + out().string()).exit_code, 3);
  for (const char* bad :
       {"--sensor hdl65", "--threads -1", "--width -5", "--width 1000000000", "--every 0"}) {
    const auto result = run_revisit(command("all", bad));
    EXPECT_EQ(result.exit_code, 2) << bad << result.out << result.err;
    EXPECT_FALSE(fs::exists(out())) << bad;
  }
}

TEST_F(ExperimentCommand, AFileThatIsNoReportIsNotReplaced) {
  test::write_file(out() / "report.html", "my thesis");
  const auto refused = run_revisit(command("networks-and-layers"));
  EXPECT_EQ(refused.exit_code, 2);
  EXPECT_NE(refused.err.find("--no-report"), std::string::npos) << refused.err;
}

TEST_F(ExperimentCommand, TheFolderOfFetchedModelsIsNotTheOneAskedFor) {
  const auto result = run_revisit(command("networks-and-layers"), "REVISIT_MODELS=/nowhere");
  EXPECT_EQ(result.exit_code, 0) << result.err;
}

TEST_F(ExperimentCommand, PlacesNeedNoDrivesAndHaveTheWidthAskedFor) {
  models::write_random_model(dir_ / "models", "alexnet", 1);
  for (int place = 0; place < 3; ++place)
    for (int scan = 0; scan < 11; ++scan) {
      const fs::path folder = dir_ / "places/objects" / std::to_string(place);
      fs::create_directories(folder);
      fs::copy_file(
          dir_ / "drive/sequences/00/velodyne" / ("00000" + std::to_string(place) + ".bin"),
          folder / (std::to_string(scan) + ".bin"));
    }
  const auto result =
      run_revisit("experiment hkust-objects easy-vs-median --hkust " + (dir_ / "places").string() +
                  " --models " + (dir_ / "models").string() + " --width 100 -o " + out().string());
  ASSERT_EQ(result.exit_code, 0) << result.err;
  const reports::Experiment objects = read("hkust-objects");
  ASSERT_EQ(objects.runs_size(), 3);
  for (const reports::ExperimentRun& run : objects.runs()) {
    EXPECT_EQ(run.state(), "done") << run.reason();
    EXPECT_NE(run.command().find(" --width 100 "), std::string::npos) << run.command();
  }
  EXPECT_NE(read("easy-vs-median").runs(0).reason().find("--kitti"), std::string::npos);
}

models::FoundModel network(const std::string& name, bool trained) {
  models::FoundModel model;
  model.name = name;
  model.prototxt = name + ".prototxt";
  model.weights = name + ".caffemodel";
  model.cut = {"p5", ""};
  model.trained = trained;
  return model;
}

TEST(ExperimentPlan, ClaimsAreThePapersForEachNetwork) {
  cli::ExperimentOptions options;
  options.names = {"comparison"};
  options.shared.data = "kitti";
  cli::Networks networks;
  networks.found = {network("a", true), network("b", true)};
  const std::vector<cli::Plan> plans = cli::make_plans(options, networks);
  std::vector<std::string> better, worse;
  for (const auto& claim : plans.at(0).claims) {
    better.push_back(claim.better());
    worse.push_back(claim.worse());
  }
  EXPECT_EQ(better.at(0), "a p5, proposed");
  EXPECT_EQ(better.at(1), "b p5, proposed");
  EXPECT_EQ(worse,
            (std::vector<std::string>{"range image (data)", "range image (data)", "VFH", "VFH",
                                      "ESF", "ESF", "GRSD", "GRSD", "FAB-MAP", "FAB-MAP"}));
}

/// A run on sequence 00 with this average precision, between `low` and `high`.
void add_run(reports::Experiment& experiment, const char* label, double value, double low,
             double high) {
  reports::ExperimentRun& run = *experiment.add_runs();
  run.set_panel("00");
  run.set_label(label);
  run.set_state("done");
  run.set_trained(true);
  run.mutable_metrics()->set_average_precision(value);
  run.mutable_metrics()->add_average_precision_ci(low);
  run.mutable_metrics()->add_average_precision_ci(high);
}

TEST(ExperimentClaims, AreUndecidedWithinTheIntervalsOfEachOther) {
  reports::Experiment experiment;
  add_run(experiment, "a", 0.507, 0.03, 1);
  add_run(experiment, "b", 0.55, 0, 1);
  add_run(experiment, "c", 0.2, 0.1, 0.52);  // holds a's, which does not hold it
  std::vector<reports::PlannedClaim> claims;
  const auto add = [&](const char* better, const char* worse, double slack) {
    claims.emplace_back();
    claims.back().set_better(better);
    claims.back().set_worse(worse);
    claims.back().set_slack(slack);
  };
  add("a", "b", 0);
  add("b", "a", 0);
  add("b", "c", 0);
  add("c", "b", 0);
  add("a", "b", 0.1);
  add("a", "b", 0.01);
  cli::check_claims(claims, &experiment);
  std::vector<std::pair<bool, bool>> found;
  for (const auto& claim : experiment.claims())
    found.emplace_back(claim.holds(), claim.undecided());
  // The last but one claims no more than that they are as good as each other.
  EXPECT_EQ(found, (std::vector<std::pair<bool, bool>>{{false, true},
                                                       {true, true},
                                                       {true, false},
                                                       {false, false},
                                                       {true, false},
                                                       {false, true}}));
}

TEST(ExperimentPlan, ALayerTablesCurvesAreNamedAfterTheirLayersOthersAfterTheirNetworks) {
  cli::ExperimentOptions options;
  options.names = {"networks-and-layers", "alignment", "hkust-rotation"};
  options.shared.data = "kitti";
  options.shared.image.sensor = "hdl64";
  options.shared.image.width = 900;
  cli::Networks networks;
  networks.found = {network("bvlc_alexnet", true), network("b", true), network("r", false)};
  const std::vector<cli::Plan> plans = cli::make_plans(options, networks);
  const auto labels = [](const cli::Plan& plan, const std::string& panel) {
    std::string text;
    for (const reports::ExperimentRun& run : plan.report.runs())
      if (run.panel() == panel) text += run.label() + (run.reason().empty() ? "; " : " (not); ");
    return text;
  };
  const std::string layers = labels(plans.at(0), "05");
  EXPECT_TRUE(layers.starts_with("bvlc_alexnet conv3+pool5; ")) << layers;
  EXPECT_TRUE(layers.ends_with("; b p5; r p5 (UNTRAINED) (not); data; ")) << layers;
  EXPECT_NE(labels(plans.at(0), "06").find("r p5 (UNTRAINED); data; "), std::string::npos);
  EXPECT_EQ(labels(plans.at(1), "05"),
            "bvlc_alexnet conv3+pool5, aligned; bvlc_alexnet conv3+pool5, not aligned; "
            "b p5, aligned; b p5, not aligned; data, aligned; data, not aligned; ");
  EXPECT_EQ(plans.at(1).arguments.at(1), (cli::Arguments{"kitti",
                                                         "--sequence",
                                                         "00",
                                                         "--every",
                                                         "1",
                                                         "--sensor",
                                                         "hdl64",
                                                         "--width",
                                                         "900",
                                                         "--model",
                                                         "bvlc_alexnet.prototxt",
                                                         "--weights",
                                                         "bvlc_alexnet.caffemodel",
                                                         "--end",
                                                         "conv3",
                                                         "--graft",
                                                         "pool5",
                                                         "--protocol",
                                                         "paper-median",
                                                         "--align",
                                                         "none"}));
  EXPECT_EQ(plans.at(0).claims.front().better(), "bvlc_alexnet conv3+pool5");
  EXPECT_EQ(plans.at(0).claims.front().worse(), "data");
  ASSERT_EQ(plans.at(1).claims.size(), 2U);
  EXPECT_EQ(plans.at(1).claims[1].better(), "b p5, aligned");
  EXPECT_EQ(plans.at(1).claims[1].worse(), "b p5, not aligned");
  EXPECT_EQ(plans.at(2).report.runs_size(), 18) << "of each network three ways of three parts";
  EXPECT_NE(plans.at(2).report.runs(0).reason().find("--hkust"), std::string::npos);
}

TEST_F(ExperimentCommand, WhatCannotRunHasOneRowAndNoEmptyTable) {
  std::ofstream(dir_ / "drive/sequences/00/simulation.txt") << "version: 1\nroute: loop\n";
  const auto result = run_revisit(command("alignment bidirectional"));
  ASSERT_EQ(result.exit_code, 0) << result.err;
  EXPECT_NE(result.out.find("Simulated drives"), std::string::npos) << result.out;
  // bidirectional takes a network, of which there is none: no header without rows.
  const std::string nothing = result.out.substr(result.out.find("Revisits in the opposite"));
  EXPECT_EQ(nothing.substr(0, nothing.find("experiment ")).find("sequence  curve"),
            std::string::npos)
      << result.out;
  size_t rows = 0;
  for (size_t at = 0; (at = result.out.find("\nalignment ", at)) != std::string::npos; ++at) ++rows;
  EXPECT_EQ(rows, 2U) << "done, skipped\n" << result.out;
}

TEST(DrawnCurve, KeepTheEndsAndDropWhatIsNotSeen) {
  std::vector<pipeline::PrPoint> curve;
  for (int i = 0; i <= 10000; ++i) {
    pipeline::PrPoint point;
    point.threshold = 1 - i * 1e-4;
    point.recall = i * 1e-4;
    point.precision = 1 - i * 0.5e-4;
    curve.push_back(point);
  }
  const auto drawn = cli::drawn_curve(curve).recall();
  EXPECT_LE(drawn.size(), 601);
  EXPECT_GE(drawn.size(), 200);
  EXPECT_EQ(drawn.Get(0), 0);
  EXPECT_EQ(drawn.Get(drawn.size() - 1), 1);
  EXPECT_TRUE(std::ranges::is_sorted(drawn));
  for (pipeline::PrPoint& point : curve) point.recall = std::nan("");
  EXPECT_EQ(cli::drawn_curve(curve).recall_size(), 0);
}

}  // namespace
}  // namespace revisit
