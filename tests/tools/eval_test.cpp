#include <sys/stat.h>

#include "cli/json.h"
#include "eval/eval_options.h"
#include "reports.pb.h"
#include "revisit/evaluation/protocols.h"
#include "revisit/proto/npy.h"
#include "small_drive.h"
#include "testing.h"

namespace revisit {
namespace {

cli::EvalOptions parsed(const cli::Arguments& arguments) {
  cli::EvalOptions eval;
  cli::Options options("revisit eval");
  eval.declare(options);
  options.parse(arguments);
  return eval;
}

/// Without the header.
std::vector<std::vector<std::string>> rows_of(const fs::path& csv) {
  std::vector<std::vector<std::string>> rows;
  std::istringstream lines(read_file(csv));
  std::string line;
  std::getline(lines, line);
  while (std::getline(lines, line)) {
    std::istringstream cells(line);
    rows.emplace_back();
    for (std::string cell; std::getline(cells, cell, ',');) rows.back().push_back(cell);
  }
  return rows;
}

std::vector<double> column_of_best_matches(const fs::path& csv, size_t column) {
  std::vector<double> values;
  for (const auto& row : rows_of(csv))
    if (row.at(2) == "1") values.push_back(std::stod(row.at(column)));
  return values;
}

class EvalCommand : public testing::Test {
 protected:
  EvalCommand() { write_small_drive(root()); }
  fs::path root() const { return dir_ / "drive"; }
  fs::path results() const { return dir_ / "results"; }
  fs::path scan(int i) const {
    return root() / str("sequences/00/velodyne/0000", i < 10 ? "0" : "", i, ".bin");
  }
  std::string eval(const std::string& more = "") const {
    return "eval " + root().string() +
           " --feature data --geometry width=400 --protocol online --exclusion frames=8 --radius 2 "
           "-o " +
           results().string() + " " + more;
  }
  fs::path run_folder() const { return fs::canonical(results() / "drive_00/latest"); }
  std::string run_json() const { return read_file(run_folder() / "run.json"); }
  static reports::Run run_in(const fs::path& folder) {
    reports::Run run;
    cli::read_report(folder / "run.json", &run);
    return run;
  }
  /// Metrics, matches and curves of a run.
  static std::string tasks_in(const fs::path& folder) {
    std::string text;
    const reports::Run run = run_in(folder);
    for (const reports::RunTask& task : run.tasks()) text += cli::to_json(task);
    return text;
  }
  std::string describe(const std::string& more, const std::string& folder) const {
    return "eval " + root().string() + " --feature data " + more + " --descriptors " +
           (dir_ / folder).string();
  }

  const TempDir dir_;
};

TEST_F(EvalCommand, WritesEveryFileOfARunAndReadsNoCalibrationThatItDoesNotNeed) {
  write_file(root() / "sequences/00/calib.txt", "P0: 1 0 0 0 0 1 0 0 0 0 1 0\n");
  const auto result = run_ok(eval());
  EXPECT_HAS(result.out, "online");
  for (const char* file :
       {"run.json", "loops_online.csv", "pr_online.csv", "scans.csv", "report.html"})
    EXPECT_TRUE(fs::exists(run_folder() / file)) << file;
  EXPECT_EQ(std::distance(fs::directory_iterator(run_folder()), {}), 5);
  EXPECT_HAS(result.out, "\nreport: ");
  const std::string loops = read_file(run_folder() / "loops_online.csv");
  EXPECT_EQ(loops.substr(0, loops.find('\n')),
            "query,match,rank,query_time,match_time,similarity,score,margin,yaw_deg,accepted,"
            "correct,positive,case");
  run_ok(eval("--no-report"));
  EXPECT_FALSE(fs::exists(run_folder() / "report.html"));
}

TEST_F(EvalCommand, AcceptedQueriesReachTheThreshold) {
  // The lowest score of an accepted query is the threshold itself, to the last digit.
  run_ok(eval("--no-report"));
  double lowest = std::numeric_limits<double>::infinity();
  for (const auto& row : rows_of(run_folder() / "loops_online.csv"))
    if (row.size() > 9 && row[9] == "1") lowest = std::min(lowest, std::stod(row[6]));
  EXPECT_EQ(lowest, run_in(run_folder()).tasks(0).metrics().f1_max_threshold());
}

TEST_F(EvalCommand, RunJsonHasScansAndQueries) {
  run_ok(eval("--no-report --protocol online,ssc"));
  const reports::Run run = run_in(run_folder());
  ASSERT_EQ(run.tasks_size(), 2);
  EXPECT_EQ(run.frame_size(), 24);
  EXPECT_EQ(run.x_size(), 24);
  const reports::RunTask& online = run.tasks(0);
  EXPECT_EQ(online.stored_size(), 24);
  EXPECT_EQ(online.scan_size(), online.metrics().n_queries());
  EXPECT_EQ(online.match_size(), 4 * online.scan_size());
  int positives = 0, found = 0;
  for (const int flags : online.flags()) {
    positives += (flags & 4) != 0;
    found += (flags & 3) == 3;
  }
  EXPECT_EQ(positives, online.metrics().n_positives());
  EXPECT_EQ(positives, 12) << "the second pass";
  EXPECT_EQ(online.metrics().recall_at_1(), 1);
  EXPECT_GT(found, 0);
  EXPECT_GT(online.curve().recall_size(), 1);
  // Pairs have a histogram instead.
  const reports::RunTask& pairs = run.tasks(1);
  EXPECT_EQ(pairs.scan_size(), 0);
  double n_correct = 0;
  for (const double count : pairs.histogram().of_correct()) n_correct += count;
  EXPECT_EQ(n_correct, pairs.metrics().n_correct_pairs());
}

TEST_F(EvalCommand, TasksThatShareDescriptorsAreAsAlone) {
  const std::string both = "--no-report --pca 5 --query-case both --protocol ";
  std::map<std::string, std::string> alone;
  for (const char* task : {"paper-easy", "online"}) {
    run_ok(eval(both + task));
    alone[task] = read_file(run_folder() / ("loops_" + std::string(task) + ".csv"));
  }
  run_ok(eval(both + "paper-easy,online"));
  for (const auto& [task, loops] : alone)
    EXPECT_EQ(read_file(run_folder() / ("loops_" + task + ".csv")), loops) << task;
  // A task in both cases and one in case 1 alone.
  run_ok(eval("--no-report --pca 5 --protocol paper-easy"));
  EXPECT_NE(read_file(run_folder() / "loops_paper-easy.csv"), alone["paper-easy"]);
}

TEST_F(EvalCommand, SaysWhereTheTimeWent) {
  const auto result = run_ok(eval("--no-report --threads 3"));
  EXPECT_HAS(result.out, "described 24 scans in ");
  const std::string run = read_file(run_folder() / "run.json");
  size_t at = 0;  // in this order
  for (const char* stage :
       {"read", "align", "project", "close", "feature", "write", "reduce", "retrieve"}) {
    EXPECT_HAS(result.out, "\n" + std::string(stage) + " ");
    at = run.find("\"name\": \"" + std::string(stage) + "\"", at);
    ASSERT_NE(at, std::string::npos) << stage << " in " << run;
  }
  EXPECT_HAS(run, "\"scans_per_second\": ");

  const auto again = run_revisit(eval("--no-report"));
  EXPECT_EQ(again.out.find("described"), std::string::npos) << "the scans were described before";
}

TEST_F(EvalCommand, ItsOwnCommandAndItsOwnConfigRepeatARun) {
  run_ok(eval("--no-report --every 2 --pca 7 --score similarity"));
  const std::string first = tasks_in(run_folder());
  const std::string command = run_in(run_folder()).info().command().substr(sizeof "revisit");
  EXPECT_HAS(command, "--every 2");
  for (const std::string& same :
       {command, "eval " + root().string() + " -c " + (run_folder() / "run.json").string()}) {
    run_ok(same + " --no-report -o " + (dir_ / "again").string());
    EXPECT_EQ(tasks_in(dir_ / "again/drive_00/latest"), first) << same;
  }
}

TEST_F(EvalCommand, ItsCommandHoldsInEveryFolderAndToTheLastDigit) {
  fs::create_directories(dir_ / "my nets/pca");
  write_file(dir_ / "my nets/w.caffemodel", "");
  const fs::path before = fs::current_path();
  fs::current_path(dir_ / "my nets");
  const std::string command = cli::command_of(
      parsed({"/data", "--model", "bvlc_alexnet", "--weights", "w.caffemodel", "--pca", "pca",
              "--radius", "2.9999999", "--geometry", "max-range=1234567", "--memory", "0.1"}));
  const std::string of_images =
      cli::command_of(parsed({"/data", "--feature", "fabmap", "--images", "pca,pca"}));
  fs::current_path(before);
  const std::string nets = "'" + (dir_ / "my nets").string();
  for (const std::string& part :
       {std::string(" --model bvlc_alexnet "), " --weights " + nets + "/w.caffemodel' ",
        " --pca " + nets + "/pca' ", std::string(" --geometry max-range=1234567 "),
        std::string(" --memory 0.1 ")})
    EXPECT_HAS(command, part);
  EXPECT_EQ(of_images, "revisit eval /data --feature fabmap --images " + nets + "/pca," +
                           nets.substr(1) + "/pca'");
  EXPECT_TRUE(command.ends_with(" --radius 2.9999999")) << command;
}

TEST_F(EvalCommand, OptionsOfAnotherFeatureAreRefusedOnTheCommandLineAlone) {
  for (const char* option : {"--end pool5", "--mean 1,2,nan", "--candidates 5", "--images x"}) {
    expect_exit(2, {" belongs to --feature "}, eval(std::string("--no-report ") + option));
  }
  expect_exit(2, {}, describe("--end pool5", "results"));
  run_ok(eval("--no-report"), "REVISIT_END=pool5");
  EXPECT_FALSE(run_in(run_folder()).configuration().contains("end"));
}

TEST_F(EvalCommand, RingsAreTheDefaultAndANetworkIsChosenByItsOptions) {
  const std::string no_models = "REVISIT_MODELS=/nowhere";
  const std::string how = "eval " + root().string() +
                          " --protocol online --exclusion frames=8 --radius 2 -q -o " +
                          results().string() + " --no-report ";
  const auto result = run_ok(how, no_models);
  EXPECT_HAS(result.out, "feature ring");
  run_ok(how, no_models + " REVISIT_END=pool5");
  write_file(dir_ / "net.yaml", "end: pool5\n");
  for (const std::string& option :
       {std::string("--model bvlc_alexnet"), std::string("--end pool5"), std::string("--mean 1"),
        "-c " + (dir_ / "net.yaml").string()}) {
    expect_exit(2, {"models"}, how + option, no_models);
  }
  EXPECT_EQ(run_revisit(how + "--feature ring --end pool5", no_models).exit_code, 2);
}

TEST_F(EvalCommand, DescriptorsTakeTheConfigurationOfARun) {
  run_ok(eval("--no-report --pca 5"));
  const std::string config = "-c " + (run_folder() / "run.json").string();
  run_ok(describe(config, "out"));
  EXPECT_EQ(proto::read_npy(dir_ / "out/descriptors.npy").shape, (std::vector<int64_t>{24, 5}));
  write_file(dir_ / "odd.yaml", "protokol: online\n");
  EXPECT_EQ(run_revisit(describe("-c " + (dir_ / "odd.yaml").string(), "out")).exit_code, 2);
}

TEST_F(EvalCommand, DescriptorsInTheCacheServeFewerComponents) {
  const fs::path cache = dir_ / "cache";
  const std::string common = "--no-report --cache " + cache.string();
  run_ok(eval(common + " --pca 0"));
  const auto files = std::distance(fs::directory_iterator(cache), {});
  run_ok(eval(common + " --pca 6"));
  const std::string cached = test::read_file(run_folder() / "loops_online.csv");
  EXPECT_EQ(std::distance(fs::directory_iterator(cache), {}), files) << "computed again";
  run_ok(eval("--no-report --pca 6"));
  EXPECT_EQ(test::read_file(run_folder() / "loops_online.csv"), cached);
}

TEST_F(EvalCommand, ALimitOnTheAddressSpaceIsOutOfMemoryNotAnEndlessLoop) {
#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)
  GTEST_SKIP() << "the sanitizers map terabytes";
#endif
  // Address space suffices for the program and its data, but not for OpenBLAS's buffer of 128 MiB.
  expect_exit(1, {"out of memory"},
              describe("--geometry width=100 --threads 1 --pca 5 -q", "results"),
              "ulimit -v 220000; OPENBLAS_NUM_THREADS=1 timeout -s KILL 60");
}

TEST_F(EvalCommand, AFileNamedLatestStays) {
  write_file(results() / "drive_00/latest", "mine");
  expect_exit(0, {"latest is not a link"}, eval("--no-report"));
  EXPECT_EQ(read_file(results() / "drive_00/latest"), "mine");
}

TEST_F(EvalCommand, EveryNthFrame) {
  run_ok(eval("--no-report --every 3"));
  std::vector<std::string> frames;
  for (const auto& row : rows_of(run_folder() / "scans.csv")) frames.push_back(row.at(0));
  EXPECT_EQ(frames, (std::vector<std::string>{"0", "3", "6", "9", "12", "15", "18", "21"}));
}

TEST_F(EvalCommand, DescriptorsAreFinite) {
  const std::string from_model =
      describe("--geometry width=100 --pca " + (results() / "pca").string(), "other");
  run_ok(describe("--geometry width=100 --pca 5", "results"));
  proto::Blob mean = proto::read_npy(results() / "pca/mean.npy");
  const auto with_mean = [&](float value) {
    std::fill(mean.data.begin() + 3, mean.data.end(), value);
    proto::write_npy(results() / "pca/mean.npy", mean.shape, mean.data.data());
  };
  with_mean(std::nanf(""));
  expect_exit(3, {"mean.npy: value 3 "}, from_model);
  with_mean(3e38F);
  expect_exit(1, {"the descriptor of scan 0 "}, from_model);
  EXPECT_FALSE(fs::exists(dir_ / "other/descriptors.npy"));
}

TEST_F(EvalCommand, OfBothAlignmentCasesTheHigherScoreWins) {
  const std::string easy = "--no-report --protocol paper-easy --query-case ";
  std::map<std::string, std::vector<double>> scores, cases;
  for (const char* which : {"1", "2", "both"}) {
    run_ok(eval(easy + which));
    const fs::path loops = run_folder() / "loops_paper-easy.csv";
    scores[which] = column_of_best_matches(loops, 6);
    cases[which] = column_of_best_matches(loops, 12);
    const std::string said =
        "\"query_case\": \"" + std::string(isdigit(*which) ? "case" : "") + which;
    EXPECT_HAS(run_json(), said);
  }
  ASSERT_EQ(scores["both"].size(), 16U);  // of 24, every third is stored
  EXPECT_EQ(cases["1"], std::vector<double>(16, 1));
  EXPECT_EQ(cases["2"], std::vector<double>(16, 2));
  for (size_t i = 0; i < 16; ++i) {
    EXPECT_NEAR(scores["both"][i], std::max(scores["1"][i], scores["2"][i]), 2e-6);
    EXPECT_EQ(cases["both"][i], scores["2"][i] > scores["1"][i] ? 2 : 1);
  }
}

TEST_F(EvalCommand, CommandLineBeatsEnvironmentBeatsConfig) {
  write_file(dir_ / "c.yaml", "k: 0\n");  // would fail
  const std::string config = " --no-report -c " + (dir_ / "c.yaml").string();
  EXPECT_EQ(run_revisit(eval(config)).exit_code, 2);
  run_ok(eval(config), "REVISIT_K=3");
  EXPECT_EQ(run_revisit(eval(config + " --k 0"), "REVISIT_K=3").exit_code, 2);
}

TEST_F(EvalCommand, FullDiskLeavesNothingThatLooksWhole) {
  // A file size limit stands for the full disk: the write fails the same way, with another errno.
  expect_exit(1, {"data-case1"}, eval(), "trap '' XFSZ; ulimit -f 256;");
  for (const auto& entry : fs::recursive_directory_iterator(results()))
    EXPECT_NE(entry.path().extension(), ".features") << entry.path();
  EXPECT_EQ(run_revisit(eval("--no-report")).exit_code, 0) << "the next run does not recover";
}

TEST_F(EvalCommand, CtrlCKeepsFeatures) {
  write_small_drive(root(), 100);
  // Waits for the first features on the disk, because machines differ in speed.
  write_file(dir_ / "stop_midway.sh",
             "\"$@\" &\n"
             "until [ -n \"$(find '" +
                 results().string() +
                 "' -name 'data*.part' -size +1k 2>/dev/null)\" ]; do\n"
                 "  kill -0 $! || exit 99\n"
                 "  sleep 0.005\n"
                 "done\n"
                 "kill -INT $!\n"
                 "wait $!\n");
  expect_exit(130, {"to resume"}, eval("--no-report --threads 1 --geometry width=4000"),
              "sh " + (dir_ / "stop_midway.sh").string());
  run_ok(eval("--no-report --geometry width=4000"));
}

TEST_F(EvalCommand, BadInputHasItsExitCode) {
  const auto expect = [&](int code, const std::string& part, const std::string& more = "") {
    expect_exit(code, {part}, eval("--no-report " + more));
  };

  const std::string good = read_file(scan(3));
  write_file(scan(3), "");
  expect(6, "000003.bin", "--protocol driving-order --pca 3 --warmup 6");
  write_file(scan(3), good);

  const std::string poses = read_file(root() / "poses/00.txt");
  write_file(root() / "poses/00.txt", poses.substr(0, poses.size() / 2));
  expect(3, "00.txt");
  fs::remove(root() / "poses/00.txt");
  expect(3, "poses");
  write_file(root() / "poses/00.txt", poses);

  expect(3, "07", "--sequence 07");
}

TEST_F(EvalCommand, MisuseIsExplained) {
  for (const char* memory : {"0", "-1", "1e-9", "nan"})
    expect_exit(2, {"--memory"}, eval(std::string("--pca 5 --memory ") + memory));
  EXPECT_FALSE(fs::exists(results()));
  write_file(dir_ / "c.yaml", "radios: 3\n");
  for (const auto& [options, part] :
       {std::pair<std::string, const char*>{"-c " + (dir_ / "c.yaml").string(),
                                            "did you mean 'radius'"},
        {"--sensor hdl65", "did you mean"},
        {"--protocol lcdnet", "did you mean 'lcdnet"},
        {"--protocol ''", "no protocol"},
        {"--protocol online,online", "twice"},
        {"--protocol online,ssc,online", "twice"},
        {"--radius -1", "--radius"},
        {"--radius inf", ""},
        {"--geometry max-range=nan", ""},
        {"--every 0", ""},
        {"--pca -1", ""},
        {"--pca x", ""},
        {"--pca none --fit-on map", ""},
        {"--query-case 2", ""},  // online stores what it asks
        {"--query-case 3", ""},
        {"--protocol paper-easy --query-case both --align none", ""},
        {"--bootstrap -1", ""},
        {"--memory inf", ""},
        {"surplus", "unexpected argument"}})
    expect_exit(2, {part}, eval(options));
}

TEST_F(EvalCommand, AScanThatCannotBeDescribedIsLeftOutAndTheDriveGoesOn) {
  const std::string good = read_file(scan(3));
  const float nan = std::numeric_limits<float>::quiet_NaN();
  std::string nans, equal;
  for (int i = 0; i < 400; ++i) {
    nans.append(reinterpret_cast<const char*>(&nan), sizeof nan);
    equal += good.substr(0, 16);
  }
  write_file(scan(3), good.substr(0, good.size() - 7));
  write_file(scan(5), "");
  write_file(scan(7), nans);
  write_file(scan(14), good.substr(0, 32));  // two returns
  write_file(scan(20), equal);
  for (const char* protocol : {"online", "paper-easy", "ssc"}) {
    SCOPED_TRACE(protocol);
    const auto result =
        run_revisit(eval("--no-report --pca 5 --query-case protocol --protocol ") + protocol);
    ASSERT_EQ(result.exit_code, 6) << result.err;
    EXPECT_HAS(result.out,
               "5 of 24 scans could not be described and were skipped: 000003.bin, "
               "000005.bin, 000007.bin, 000014.bin, 000020.bin\n");
    const reports::Run run = run_in(run_folder());
    EXPECT_EQ(run.tasks(0).metrics().n_skipped(), 5);
    EXPECT_EQ(run.info().n_skipped(), 5);
    EXPECT_HAS(run.info().skipped(3), "000014.bin");
    std::string line;
    std::istringstream scans(read_file(run_folder() / "scans.csv"));
    while (std::getline(scans, line))
      if (line.starts_with("3,") || line.starts_with("20,")) {
        EXPECT_TRUE(line.ends_with(",")) << "stored: " << line;
      }
    if (std::string(protocol) == "ssc") continue;
    for (const auto& row : rows_of(run_folder() / str("loops_", protocol, ".csv")))
      for (const char* frame : {"3", "5", "7", "14", "20"}) {
        EXPECT_NE(row.at(0), frame) << "asked";
        EXPECT_NE(row.at(1), frame) << "found";
      }
  }
  expect_exit(6, {"000003.bin: ", "16 bytes", "000005.bin: ", "000007.bin: "},
              eval("--no-report --pca 4 --geometry width=200"));
  const auto kept = run_revisit(eval("--no-report --pca 5"));
  EXPECT_EQ(kept.exit_code, 6) << "the cache holds scans that were left out";
  EXPECT_HAS(kept.out, "000003.bin");

  // Equal points have an image without alignment.
  const auto none = run_revisit(eval("--no-report --align none"));
  EXPECT_EQ(none.exit_code, 6) << none.err;
  EXPECT_HAS(none.out, "3 of 24 scans could not be described");

  expect_exit(6, {}, describe("--geometry width=100 --pca 5", "described"));
  EXPECT_HAS(read_file(dir_ / "described/scans.csv"), ",described,stored\n");

  for (int i = 0; i < 24; ++i) write_file(scan(i), "short");
  EXPECT_EQ(run_revisit(eval("--no-report")).exit_code, 3) << "nothing is left";
}

TEST_F(EvalCommand, DamagedFilesOfTheCacheAreMadeAnew) {
  const fs::path cache = dir_ / "cache";
  const std::string command = eval("--no-report --pca 5 --cache " + cache.string());
  run_ok(command);
  const std::string loops = read_file(run_folder() / "loops_online.csv");
  std::map<fs::path, std::string> kept;  // features, times, descriptors
  for (const auto& entry : fs::directory_iterator(cache))
    kept[entry.path()] = read_file(entry.path());
  ASSERT_EQ(kept.size(), 3U);
  for (const auto& [file, good] : kept) {
    const std::string name = file.filename().string();
    const bool times = name.ends_with("-times.npy");
    std::string flipped = good;
    flipped[good.size() - 2] = static_cast<char>(flipped[good.size() - 2] ^ 0x20);
    for (const std::string& bad :
         {good.substr(0, good.size() / 2), std::string("garbage"), std::string(), flipped}) {
      SCOPED_TRACE(name + ": " + bad.substr(0, 7));
      if (times && bad == flipped) continue;  // no metric depends on them
      if (!name.starts_with("descriptors"))   // these would suffice
        for (const auto& [other, content] : kept)
          if (other.filename().string().starts_with("descriptors")) fs::remove(other);
      write_file(file, bad);
      const auto again = run_ok(command, "timeout 60");
      EXPECT_HAS(again.err, name) << "no note";
      EXPECT_EQ(read_file(run_folder() / "loops_online.csv"), loops);
      if (!times) {
        EXPECT_TRUE(read_file(file) == good) << "not regenerated";
      }
      if (times) write_file(file.string() + ".new", good);
      if (times) fs::rename(file.string() + ".new", file);
    }
  }
  const fs::path pipe = std::ranges::find_if(kept, [](const auto& file) {
                          return file.first.filename().string().starts_with("data") &&
                                 file.first.extension() == ".features";
                        })->first;
  ASSERT_TRUE(fs::remove(pipe) && ::mkfifo(pipe.c_str(), 0600) == 0);
  expect_exit(1, {pipe.string() + ": is a FIFO"}, command, "timeout 60");
}

TEST_F(EvalCommand, FeaturesOfAnotherVersionAreNotUsed) {
  run_ok(eval("--no-report"));
  // Simulates files of an earlier program, which have another version in their keys.
  for (const auto& entry : fs::directory_iterator(results() / "features"))
    if (entry.path().extension() == ".features") {
      std::string content = read_file(entry.path());
      const size_t version = content.find("version ");
      ASSERT_LT(version, 300U);
      content.replace(version + 8, 1, "0");
      write_file(entry.path(), content);
    }
  const auto again = run_ok(eval("--no-report"));
  EXPECT_HAS(again.out, "described 24 scans");
}

TEST_F(EvalCommand, WithoutPcaTheFeatureItselfIsCompared) {
  run_ok(eval("--no-report --pca none"));
  const fs::path loops = run_folder() / "loops_online.csv";
  const std::string raw = read_file(loops);
  EXPECT_EQ(run_in(run_folder()).configuration().at("pca"), "none");
  // Pixels are not negative, nor are cosines of images; minus the mean, some are.
  for (const double cosine : column_of_best_matches(loops, 5)) EXPECT_GE(cosine, 0);
  run_ok(eval("--no-report --pca all"));
  const std::string all = read_file(run_folder() / "loops_online.csv");
  EXPECT_NE(all, raw);
  run_ok(eval("--no-report --pca 0"));
  EXPECT_EQ(read_file(run_folder() / "loops_online.csv"), all);
}

TEST_F(EvalCommand, ProtocolListNeedsNoData) {
  for (const char* arguments : {"eval --protocol list", "eval --protocol=list"}) {
    const auto result = run_ok(arguments);
    for (const std::string& name : protocol_names())
      EXPECT_HAS("\n" + result.out, "\n" + name + "\n") << name;
  }
}

TEST_F(EvalCommand, ADriveThatIsOnlyCalledLikeKittisIsNotTakenForIt) {
  expect_exit(2, {"4541 poses; this drive 00 has 24"}, eval("--no-report --protocol paper-median"));
  // Default protocols work for any drive.
  run_ok("eval " + root().string() +
         " --feature scan-context --exclusion frames=8 --no-report -o " + results().string());
  EXPECT_TRUE(fs::exists(run_folder() / "pr_driving-order.csv"));

  run_ok(eval("--no-report --protocol paper-easy --every 3"));  // of these, too, a third is stored
}

TEST_F(EvalCommand, PlacesNeedNamesAndNoPoses) {
  fs::remove(root() / "poses/00.txt");
  expect_exit(2, {"needs named places"},
              "eval " + root().string() + " --feature data --protocol places-3");
}

TEST_F(EvalCommand, AFolderPerPlaceIsTheTruth) {
  const fs::path set = dir_ / "sets/rotation";
  for (int place = 0; place < 3; ++place) {
    const fs::path folder = set / ("place_" + std::to_string(place));
    fs::create_directories(folder);
    for (int copy = 0; copy < 4; ++copy) fs::copy_file(scan(3 * place), folder / str(copy, ".bin"));
  }
  const auto result =
      run_ok("eval " + (dir_ / "sets").string() +
             " --sequence rotation --feature data --geometry width=400 --protocol places-3 "
             "--no-report --format json -o " +
             results().string());
  for (const char* part : {"\"recall_at_1\": 1,", "\"n_queries\": 8,", "\"n_positives\": 8,",
                           "\"pose_source\": \"names of the places\"", "\"distance\": \"place\""})
    EXPECT_HAS(result.out, part);
  run_ok("report " + results().string() + " -o " + (dir_ / "report.html").string());
}

TEST_F(EvalCommand, PairProtocolsWriteTheirFiles) {
  const auto result =
      run_ok("eval " + root().string() +
             " --feature data --geometry width=400 --protocol ssc --exclusion frames=8 "
             "-o " +
             results().string());
  EXPECT_HAS(result.out, " of them correct");
  for (const char* file : {"run.json", "pr_ssc.csv", "report.html"})
    EXPECT_TRUE(fs::exists(run_folder() / file)) << file;
  EXPECT_FALSE(fs::exists(run_folder() / "loops_ssc.csv"));
  const std::string metrics = run_json();
  for (const char* part :
       {"\"decision\": \"pair\"", "\"n_correct_pairs\": ", "\"recall_at_1_ci\": []",
        "\"negative_radius_m\": 20", "\"definition\": \"pairs nearer than 3 m"})
    EXPECT_HAS(metrics, part);
  EXPECT_EQ(metrics.find("\"recall_at_1\":"), std::string::npos);
}

TEST_F(EvalCommand, BootstrapIsPartOfTheResultAndCanBeLeftOut) {
  const std::string blocks = "--no-report --bootstrap 1000,frames=3 ";
  run_ok(eval(blocks));
  const std::string with = run_json(), tasks = tasks_in(run_folder());
  EXPECT_HAS(with, "\"bootstrap_resamples\": 1000");
  EXPECT_HAS(with, "\"bootstrap_blocks\": 5") << "frames 9 to 23";
  EXPECT_EQ(with.find("\"average_precision_ci\": []"), std::string::npos) << with;
  const auto threads = run_revisit(eval(blocks + "--threads 3"));
  EXPECT_EQ(tasks_in(run_folder()), tasks) << threads.err;
  const auto without = run_ok(eval("--no-report --bootstrap 0"));
  EXPECT_EQ(without.out.find("95 %"), std::string::npos);
  const std::string metrics = run_json();
  EXPECT_EQ(metrics.find("bootstrap_resamples"), std::string::npos);
  EXPECT_HAS(metrics, "\"average_precision_ci\": []");
  run_ok(eval("--no-report"));
  EXPECT_HAS(run_json(), "\"average_precision_ci\": []") << "all is one block of 100 m";
}

TEST_F(EvalCommand, ScoreIsTheProtocolsUnlessAsked) {
  const auto score = [&](const std::string& more) {
    const auto result = run_ok(eval("--no-report --format json " + more));
    return result.out.find("\"score\": \"margin\"") != std::string::npos       ? "margin"
           : result.out.find("\"score\": \"similarity\"") != std::string::npos ? "similarity"
                                                                               : "none";
  };
  EXPECT_STREQ(score(""), "margin");
  EXPECT_STREQ(score("--score similarity"), "similarity");
  EXPECT_STREQ(score("--protocol logg3d --exclusion frames=8"), "similarity");
  EXPECT_STREQ(score("--protocol logg3d --exclusion frames=8 --score margin"), "margin");
}

TEST_F(EvalCommand, DescriptorsAreWrittenWithTheirPcaModel) {
  const fs::path out = dir_ / "out";
  const std::string common = "--geometry width=400 --pca ";
  run_ok(describe(common + "5", "out"));
  for (const char* file :
       {"descriptors.npy", "scans.csv", "run.json", "pca/mean.npy", "pca/basis.npy"})
    EXPECT_TRUE(fs::exists(out / file)) << file;
  EXPECT_EQ(run_in(out).info().descriptor_dimension(), 5);
  const std::string fitted = common + (out / "pca").string();
  run_ok(describe(fitted, "two"));
  run_ok(describe(fitted + " --cache " + (dir_ / "c").string(), "three"));
  EXPECT_TRUE(fs::exists(dir_ / "three/descriptors.npy"));
}

TEST_F(EvalCommand, GroundTruthIsAListOfPairs) {
  const fs::path file = dir_ / "pairs.csv";
  const auto result = run_ok("eval " + root().string() + " --ground-truth " + file.string() +
                             " --exclusion frames=21 --radius 2");
  EXPECT_EQ(result.out.find(" of 2 queries have a correct match: "), 1U) << result.out;
  const std::string pairs = read_file(file);
  EXPECT_TRUE(pairs.starts_with("query,match,distance_m\n")) << pairs;
  EXPECT_FALSE(fs::exists(results()));
  for (const char* bad : {"--exclusion frames", "--radius 0", "--distance yz", "--perturb none"})
    EXPECT_EQ(run_revisit("eval " + root().string() + " --ground-truth x " + bad).exit_code, 2)
        << bad;
}

}  // namespace
}  // namespace revisit
