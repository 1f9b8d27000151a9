#include <gtest/gtest.h>

#include <filesystem>

#include "cli/json.h"
#include "expect_error.h"
#include "program_test.h"
#include "report/read_runs.h"
#include "reports.pb.h"
#include "robustness/robustness_options.h"
#include "small_drive.h"

namespace revisit::cli {
namespace {

namespace fs = std::filesystem;

class RobustnessOfFeatures : public test::ProgramTest<RobustnessOfFeatures> {
 public:
  static void fill() {
    run("simulate -o " + path("town") +
        " --sensor vlp16 --route opposite --length 300 --every 12 -q");
  }

 protected:
  static reports::Robustness ask(const std::string& options, const std::string& output) {
    reports::Robustness report;
    parse_report(test::run_revisit("robustness " + path("town") + " -q --format json -o " +
                                   path(output) + " " + options)
                     .out,
                 "robustness", &report);
    return report;
  }
};

TEST_F(RobustnessOfFeatures, FeaturesStandSideBySide) {
  const reports::Robustness report =
      ask("--feature scan-context,data --pca none --perturb none --perturb turn=180 --perturb "
          "sector=90 "
          "--perturb range=1",
          "both");
  ASSERT_EQ(report.features_size(), 2);
  for (const reports::RobustnessFeature& feature : report.features()) {
    SCOPED_TRACE(feature.label());
    ASSERT_EQ(feature.rows_size(), 4);
    const reports::RobustnessRow& unperturbed = feature.rows(0);
    EXPECT_EQ(unperturbed.name(), "unperturbed");
    EXPECT_EQ(unperturbed.own(), unperturbed.asked());
    EXPECT_EQ(unperturbed.asked(), report.stored());
    EXPECT_GT(unperturbed.asked_near(), 0);
    EXPECT_GE(unperturbed.ratio_median(), unperturbed.ratio_least());
    EXPECT_GT(unperturbed.ratio_median(), 0);
    const reports::RobustnessRow& gone = feature.rows(3);
    EXPECT_EQ(gone.not_described(), gone.asked());
    EXPECT_EQ(gone.own() + gone.near(), 0);
  }
  // Scan Context rotates by its columns; an image aligned in case 1 alone may be reversed.
  const reports::RobustnessRow& turned = report.features(0).rows(1);
  EXPECT_EQ(turned.own(), turned.asked());
  const fs::path folder = report.folder();
  for (const char* file : {"robustness.json", "robustness.csv", "report.html"})
    EXPECT_TRUE(fs::exists(folder / file)) << file;
  EXPECT_TRUE(fs::exists(folder.parent_path() / "latest/robustness.json"));
  EXPECT_HAS(test::read_file(folder / "robustness.csv"), "scan-context,turn=180,yaw 180 deg,");
}

TEST_F(RobustnessOfFeatures, BothCasesFindScansThatAreReversed) {
  const std::string options = "--feature data --pca none --perturb turn=180 --query-case ";
  const reports::RobustnessRow one = ask(options + "1", "case1").features(0).rows(0);
  const reports::RobustnessRow both = ask(options + "both", "case1").features(0).rows(0);
  EXPECT_LT(one.own(), one.asked());
  EXPECT_EQ(both.own(), both.asked());
}

TEST_F(RobustnessOfFeatures, TheTableHasARowForEachAlteration) {
  const std::string out = run("robustness " + path("town") + " -q --no-report -o " + path("table") +
                              " --feature scan-context --queries 2");
  EXPECT_HAS(out, "scan-context: self");
  EXPECT_HAS(out, "unperturbed");
  for (const Perturbation& perturbation : standard_perturbations())
    EXPECT_HAS(out, name_of(perturbation));
}

TEST_F(RobustnessOfFeatures, AReportPutsWhatWasAskedTheSameTogether) {
  const std::string same = "--perturb none --perturb pitch=5 --queries 3 ";
  ask(same + "--feature scan-context", "merged");
  ask(same + "--feature m2dp --label \"another\"", "merged");
  ask(same + "--feature scan-context", "merged");
  ask(same + "--feature scan-context --seed 1", "merged");
  const reports::Page page = read_runs({path("merged")});
  ASSERT_EQ(page.robustness_size(), 2) << "another seed is another question";
  ASSERT_EQ(page.robustness(0).features_size(), 3);
  EXPECT_EQ(page.robustness(0).features(0).label(), "scan-context");
  EXPECT_EQ(page.robustness(0).features(1).label(), "another");
  EXPECT_EQ(page.robustness(0).features(2).label(), "scan-context (2)");
  EXPECT_EQ(page.robustness(1).seed(), 1);
  EXPECT_HAS(run("report " + path("merged") + " -o " + path("merged.html")),
             "tables of robustness: 2");
}

TEST_F(RobustnessOfFeatures, OtherPlacesAreStored) {
  const std::string options = "--feature scan-context --perturb none --queries 2 ";
  run("simulate -o " + path("elsewhere") + " --sensor vlp16 --seed 9 --length 300 --every 40 -q");
  const reports::Robustness alone = ask(options, "among"),
                            more = ask(options + "--distractors " + path("elsewhere"), "among");
  EXPECT_GT(more.stored(), alone.stored());
  EXPECT_EQ(more.features(0).rows(0).own(), 2);
}

TEST_F(RobustnessOfFeatures, MistakesAreSaidBeforeAnyWork) {
  for (const auto& [options, message] : std::vector<std::pair<std::string, std::string>>{
           {"--perturb pich=5", "unknown step 'pich' (did you mean 'pitch'?)"},
           {"--perturb none --perturb none", "--perturb: none is given twice"},
           {"--perturb pitch=5+range=x", "range takes more than 0"},
           {"--feature rings", "unknown feature 'rings' (did you mean 'ring'?)"},
           {"--feature ring,ring", "ring is given twice"},
           {"--feature data,m2dp --label x", "--label: not with several features"},
           {"--feature data,m2dp --ring x", "--ring belongs to --feature ring"},
           {"--radius 0", "--radius: expected a positive number"},
           {"--negative-radius 2", "--negative-radius: expected at least the radius"},
           {"--seed -1", "--seed: expected 0 to 4294967295"},
           {"--queries -1", "--queries: expected at least 0"}}) {
    EXPECT_HAS(run("robustness " + path("town") + " " + options + " -o " + path("none"), 2),
               message);
    EXPECT_FALSE(fs::exists(path("none"))) << options;
  }
  EXPECT_HAS(
      run("robustness " + path("town/sequences/00/velodyne") + " --feature data -o " + path("none"),
          3),
      "pose");
}

}  // namespace
}  // namespace revisit::cli
