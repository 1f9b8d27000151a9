#include "cli/json.h"
#include "program_test.h"
#include "reports.pb.h"
#include "revisit/datasets/perturbation.h"
#include "small_drive.h"
#include "testing.h"

namespace revisit::cli {
namespace {

class PerturbOption : public test::ProgramTest<PerturbOption> {
 public:
  static void fill() {
    run("simulate -o " + path("town") +
        " --sensor vlp16 --route opposite --length 300 --every 12 -q");
  }

 protected:
  static reports::Run eval(const std::string& options, const std::string& output) {
    reports::Run run;
    parse_report(test::run_revisit("eval " + path("town") + " -q --format json -o " + path(output) +
                                   " --queries 0 " + options)
                     .out,
                 "eval", &run);
    return run;
  }
  static reports::Metrics first(const reports::Run& run) { return run.tasks(0).metrics(); }
};

TEST_F(PerturbOption, EveryPerturbationIsATask) {
  const reports::Run run =
      eval("--feature scan-context --perturb none,turn=180,sector=90,range=1", "both");
  ASSERT_EQ(run.tasks_size(), 4);
  const reports::Metrics& unperturbed = run.tasks(0).metrics();
  EXPECT_EQ(unperturbed.protocol(), "none");
  EXPECT_EQ(unperturbed.self(), unperturbed.n_queries());
  EXPECT_GT(unperturbed.n_positives(), 0);
  EXPECT_GE(unperturbed.ratio_median(), unperturbed.ratio_min());
  EXPECT_GT(unperturbed.ratio_median(), 0);
  const reports::Metrics& turned = run.tasks(1).metrics();
  EXPECT_EQ(turned.self(), turned.n_queries()) << "Scan Context rotates by its columns";
  const reports::Metrics& gone = run.tasks(3).metrics();
  EXPECT_EQ(gone.n_skipped_queries(), gone.n_queries());
  EXPECT_EQ(gone.self() + gone.neighbor(), 0);
  const fs::path folder = run.folder();
  for (const char* file : {"run.json", "perturbed.csv", "report.html"})
    EXPECT_TRUE(fs::exists(folder / file)) << file;
  EXPECT_TRUE(fs::exists(folder.parent_path() / "latest/run.json"));
  EXPECT_HAS(read_file(folder / "perturbed.csv"), "turn=180,");
  EXPECT_HAS(run.info().command(), "--perturb none,turn=180,sector=90,range=1");
}

TEST_F(PerturbOption, BothCasesFindScansThatAreReversed) {
  const std::string options = "--feature data --pca none --perturb turn=180 --query-case ";
  const reports::Metrics one = first(eval(options + "1", "case1")),
                         both = first(eval(options + "both", "case1"));
  EXPECT_LT(one.self(), one.n_queries());
  EXPECT_EQ(both.self(), both.n_queries());
}

TEST_F(PerturbOption, TheTableHasARowForEachPerturbation) {
  const std::string out = run("eval " + path("town") + " -q --no-report -o " + path("table") +
                              " --feature scan-context --queries 2 --perturb standard");
  EXPECT_HAS(out, "perturbation");
  for (const Perturbation& perturbation : standard_perturbations())
    EXPECT_HAS(out, text_of(perturbation));
}

TEST_F(PerturbOption, DistractorsAreStored) {
  const std::string options = "--feature scan-context --perturb none --queries 2 ";
  run("simulate -o " + path("elsewhere") + " --sensor vlp16 --seed 9 --length 300 --every 40 -q");
  EXPECT_EQ(first(eval(options + "--distractors " + path("elsewhere"), "more")).self(), 2);
  EXPECT_HAS(run("eval " + path("town") + " -o " + path("none") + " --perturb none --distractors " +
                     path("town"),
                 2),
             "is a scan of the drive itself");
}

TEST_F(PerturbOption, RejectsInvalidOptionsBeforeAnyWork) {
  for (const auto& [options, message] : std::vector<std::pair<std::string, std::string>>{
           {"--perturb pich=5", "unknown step 'pich' (did you mean 'pitch'?)"},
           {"--perturb none,none", "--perturb: none is given twice"},
           {"--perturb pitch=5+range=x", "range takes more than 0"},
           {"--perturb none --radius 0", "--radius: expected a positive number"},
           {"--perturb none --radius 5 --negative-radius 2",
            "--negative-radius: expected at least the radius"},
           {"--perturb none --seed -1", "--seed: expected 0 to 4294967295"},
           {"--perturb none --queries -1", "--queries: expected at least 0"},
           {"--perturb none --protocol online", "--perturb: not with --protocol"},
           {"--perturb none --query-case 2", "perturbed queries have case 1 or both"},
           {"--seed 3", "--seed: needs --perturb"}}) {
    EXPECT_HAS(run("eval " + path("town") + " " + options + " -o " + path("none"), 2), message);
    EXPECT_FALSE(fs::exists(path("none"))) << options;
  }
  EXPECT_HAS(run("eval " + path("town/sequences/00/velodyne") +
                     " --feature data --perturb none -o " + path("none"),
                 3),
             "pose");
}

}  // namespace
}  // namespace revisit::cli
