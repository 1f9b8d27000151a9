#include "report/report.h"

#include <png.h>
#include <sys/stat.h>
#include <unistd.h>

#include <future>
#include <regex>

#include "small_drive.h"
#include "testing.h"

namespace revisit {
namespace {

TEST(HtmlPage, NothingInTheDataBecomesMarkup) {
  reports::Page page;
  page.set_title("</title><script>alert(1)</script>");
  page.add_runs()->set_title("</script><script>alert(2)</script><!--");
  const std::string html = cli::html_page(page);
  EXPECT_EQ(html.find("alert(1)</script>"), std::string::npos);
  EXPECT_EQ(html.find("</script><script>alert(2)"), std::string::npos);
  EXPECT_EQ(html.find("<!--"), std::string::npos);
  EXPECT_HAS(html, "\\u003c/script\\u003e");
}

TEST(HtmlPage, NeedsNothingFromTheNetwork) {
  const std::string html = cli::html_page({});
  for (const char* reference : {"src=\"http", "href=\"http", "@import", "url(http"})
    EXPECT_EQ(html.find(reference), std::string::npos) << reference;
}

/// Counts exact matches in a PNG; -1 if it cannot be read.
int64_t pixels_of_color(const fs::path& file, int red, int green, int blue) {
  png_image png{};
  png.version = PNG_IMAGE_VERSION;
  if (!png_image_begin_read_from_file(&png, file.c_str())) return -1;
  png.format = PNG_FORMAT_RGB;
  std::vector<uint8_t> pixels(PNG_IMAGE_SIZE(png));
  if (!png_image_finish_read(&png, nullptr, pixels.data(), 0, nullptr)) return -1;
  int64_t count = 0;
  for (size_t i = 0; i + 2 < pixels.size(); i += 3)
    count += pixels[i] == red && pixels[i + 1] == green && pixels[i + 2] == blue;
  return count;
}

class ReportCommand : public testing::Test {
 protected:
  ReportCommand() { write_small_drive(dir_ / "drive", 240); }
  std::string path(const std::string& name) const { return (dir_ / name).string(); }
  void experiment() const {
    // KITTI's 00 with only its first scans.
    const fs::path poses = dir_ / "drive/poses/00.txt";
    std::string lines = read_file(poses);
    for (int frame = 240; frame < 4541; ++frame) lines += "1 0 0 0 0 1 0 0 0 0 1 0\n";
    write_file(poses, lines);
    fs::create_directory(dir_ / "models");
    run_ok("eval " + path("drive") + " --plan alignment,comparison --model " + path("models") +
           " --geometry width=100 -o " + path("out"));
  }
  void evaluate(const std::string& protocol) const {
    run_ok("eval " + path("drive") + " --feature data --geometry width=100 --protocol " + protocol +
           " -o " + path("results"));
  }

  const TempDir dir_;
};

class ReportInABrowser : public ReportCommand {
 protected:
  void SetUp() override {
    for (const char* name : {"chromium", "chromium-browser", "google-chrome"})
      if (browser_.empty() &&
          std::system(("command -v " + std::string(name) + " >/dev/null 2>&1").c_str()) == 0)
        browser_ = name;
    if (browser_.empty()) GTEST_SKIP() << "no browser here (Debian: chromium)";
  }
  /// Returns the browser's output, standard error first.
  std::string browse(const std::string& page, const std::string& options) const {
    const std::string command = "HOME=" + path("home") + " timeout 120 " + browser_ +
                                " --headless --no-sandbox --disable-gpu --disable-dev-shm-usage "
                                "--hide-scrollbars --virtual-time-budget=10000 "
                                "--enable-logging=stderr " +
                                options + " 'file://" + page + "' > " + path("stdout") + " 2> " +
                                path("stderr");
    EXPECT_EQ(std::system(command.c_str()), 0) << read_file(dir_ / "stderr");
    return read_file(dir_ / "stderr") + read_file(dir_ / "stdout");
  }
  /// Returns the page as drawn; its scripts must not report errors.
  std::string drawn(const std::string& page) const {
    const std::string dom = browse(page, "--dump-dom");
    EXPECT_EQ(dom.find("CONSOLE"), std::string::npos) << dom.substr(dom.find("CONSOLE"), 500);
    return dom;
  }

  std::string browser_;
};

TEST_F(ReportCommand, RejectsOutputsItCannotWriteBeforeAnyWork) {
  fs::create_directory(dir_ / "folder");
  fs::create_directory(dir_ / "empty");
  expect_exit(2, {"is a folder"}, "report " + path("empty") + " -o " + path("folder"));
  EXPECT_FALSE(fs::exists(dir_ / "r.html"));
}

TEST_F(ReportCommand, ToAPipeGoesThePageOnly) {
  evaluate("online --exclusion frames=60 --no-report");
  ASSERT_EQ(::mkfifo((dir_ / "fifo").c_str(), 0600), 0);
  const fs::path before = fs::current_path();
  fs::current_path(dir_.path());
  fs::create_symlink("/proc/self/fd/1", "out");  // as /dev/stdout, which a fault would destroy
  const auto page = run_revisit("report results -o out");
  auto reader =
      std::async(std::launch::async, [] { return std::system("timeout 60 cat fifo > copy.html"); });
  const auto piped = run_revisit("report results -o fifo");
  EXPECT_EQ(reader.get(), 0);
  fs::current_path(before);
  EXPECT_EQ(page.exit_code, 0) << page.err;
  EXPECT_TRUE(page.out.starts_with("<!") && page.out.ends_with("</html>\n")) << page.err;
  EXPECT_EQ(piped.exit_code, 0) << piped.err;
  EXPECT_TRUE(fs::is_fifo(dir_ / "fifo"));
  EXPECT_TRUE(read_file(dir_ / "copy.html").ends_with("</html>\n"));
}

TEST_F(ReportCommand, OneFileOfARun) {
  evaluate("online --exclusion frames=60 --no-report");
  run_ok("report " + path("results") + " -o " + path("r.html"));
  const std::string html = read_file(dir_ / "r.html");
  EXPECT_HAS(html, "data:image/png;base64,") << "no range image";
  EXPECT_HAS(html, "revisit eval " + path("drive")) << "no command";

  // Missing scans are no error, and the limit on images holds.
  fs::remove_all(dir_ / "drive/sequences/00/velodyne");
  const auto without = run_revisit("report " + path("results") + " -o " + path("s.html"));
  EXPECT_EQ(without.exit_code, 0) << without.err;
  EXPECT_HAS(without.err, "range images are missing");
  EXPECT_EQ(read_file(dir_ / "s.html").find("data:image/png"), std::string::npos);
}

TEST_F(ReportCommand, ImagesAreMadeOnceForEachScanAndCase) {
  reports::RunInfo info;
  info.set_align("none");
  info.set_image_width(100);
  info.set_image_height(112);
  info.set_elevation_top_deg(3);
  info.set_elevation_bottom_deg(-25);
  info.set_max_range_m(80);
  info.set_closing_width(5);
  info.set_closing_height(3);
  cli::RangeImages images(1'000'000);
  const std::string scan = path("drive/sequences/00/velodyne/000001.bin");
  const std::string key = images.add(scan, info, false);
  ASSERT_NE(key, "") << images.warning();
  EXPECT_EQ(images.add(scan, info, false), key);
  EXPECT_NE(images.add(scan, info, true), key);
  EXPECT_EQ(images.images().size(), 2U);
  // A PNG begins with 89 50 4e 47 0d 0a.
  EXPECT_TRUE(images.images().at(key).starts_with("data:image/png;base64,iVBORw0K"));
  EXPECT_EQ(images.add(path("none.bin"), info, false), "");
  EXPECT_HAS(images.warning(), "none.bin");
}

/// Queries are the first scans, one per entry of `flags`.
reports::Page one_task(int scans, std::initializer_list<int> flags) {
  reports::Page page;
  reports::Run& run = *page.add_runs();
  run.mutable_info()->set_align("none");
  reports::RunTask& task = *run.add_tasks();
  for (int i = 0; i < scans; ++i) {
    run.add_file("none.bin");
    run.add_frame(i);
  }
  for (const int flag : flags) {
    task.add_scan(task.flags_size());
    task.add_flags(flag);
    task.add_score(static_cast<float>(task.flags_size()) / 10);
    for (const int match : {scans - 1, -1}) task.add_match(match);
    for (const float similarity : {0.5F, 0.0F}) task.add_similarity(similarity);
  }
  return page;
}

TEST(Page, ShowsTheSurestErrorsTheFaintestMissesAndRightOnesFromAllOver) {
  // Scores grow by 0.1: accepted but ignored, incorrect (2), missed (2), correct (3).
  reports::Page page = one_task(10, {1 + 8, 1, 1, 4, 4, 1 + 2 + 4, 7, 7});
  cli::PageOptions options;
  options.queries = 1;
  cli::complete_page(options, &page);
  const reports::RunTask& task = page.runs(0).tasks(0);
  std::vector<std::pair<std::string, int>> shown;
  for (const reports::ShownQuery& query : task.shown())
    shown.emplace_back(query.kind(), query.query());
  EXPECT_EQ(shown, (std::vector<std::pair<std::string, int>>{
                       {"incorrect", 2}, {"missed", 3}, {"correct", 6}}));
  EXPECT_EQ(task.shown(0).images_size(), 3) << "the query and two matches";
  EXPECT_EQ(page.runs(0).file_size(), 0) << "where the scans are is not in the page";
}

TEST(Page, RunsOnTheSameScansShareThemAndOneOfEachDriveIsShownInDetail) {
  reports::Page page = one_task(3, {7, 7});
  for (int i = 0; i < 2; ++i) {
    const reports::Run copy = page.runs(0);
    *page.add_runs() = copy;
  }
  page.mutable_runs(2)->set_frame(0, 17);
  reports::Experiment& experiment = *page.add_experiments();
  for (int i = 0; i < 3; ++i) experiment.add_runs()->set_run(i);
  cli::complete_page({}, &page);
  EXPECT_FALSE(page.runs(0).has_scans_of());
  EXPECT_EQ(page.runs(1).scans_of(), 0);
  EXPECT_EQ(page.runs(1).frame_size(), 0);
  EXPECT_FALSE(page.runs(2).has_scans_of());
  EXPECT_EQ(page.runs(0).tasks(0).shown_size(), 2);
  const reports::RunTask& other = page.runs(1).tasks(0);
  EXPECT_EQ(other.shown_size() + other.similarity_size(), 0);
  EXPECT_EQ(std::vector<int>(other.match().begin(), other.match().end()), (std::vector<int>{2, 2}));
}

TEST_F(ReportCommand, RejectsFoldersWithoutRun) {
  expect_exit(3, {"no run.json"}, "report " + path("drive") + " -o " + path("r.html"));
  EXPECT_HAS(run_revisit("report " + path("nowhere")).err, "nowhere: No such file");
  write_file(dir_ / "bad/experiment.json", "{\"runs\": 3}");
  EXPECT_EQ(run_revisit("report " + path("bad") + " -o " + path("r.html")).exit_code, 3);
  EXPECT_FALSE(fs::exists(dir_ / "r.html"));
}

TEST_F(ReportCommand, OnlyReportsAreReplaced) {
  evaluate("leave-one-out --no-report");
  const std::string report = "report " + path("results") + " -o " + path("r.html");
  run_ok(report);
  EXPECT_EQ(run_revisit(report).exit_code, 0) << "a report may be made again";
  write_file(dir_ / "r.html", "my thesis");
  expect_exit(2, {"--force"}, report);
  EXPECT_EQ(read_file(dir_ / "r.html"), "my thesis");
  run_ok(report + " --force");
  EXPECT_NE(read_file(dir_ / "r.html"), "my thesis");
}

TEST_F(ReportCommand, AForeignRunIsRefusedWhereItsPartsDoNotFit) {
  const auto with = [&](const std::string& run) {
    write_file(dir_ / "foreign/run.json", run);
    auto result = run_revisit("report " + path("foreign") + " -o " + path("r.html"));
    fs::remove(dir_ / "r.html");
    return result;
  };
  const std::string scan = R"({"frame": [0])";
  const std::string file = R"(, "file": ["a.bin"])";
  EXPECT_EQ(with(scan + file + "}").exit_code, 0);
  EXPECT_EQ(with(scan + file + R"(, "tasks": [{"metrics": {"protocol": "../</script>"},
                       "scan": [0], "match": [-1], "similarity": [0], "score": [1], "flags": [1]}]})")
                .exit_code,
            0);
  EXPECT_EQ(with(scan + "}").exit_code, 3) << "no file of the scan";
  for (const char* bad :
       {R"("x": [1, 2], "z": [1, 2])", R"("x": [1])", R"("yaw_deg": [1])", R"("mirrored": [1])",
        R"("tasks": [{"stored": [1]}])", R"("tasks": [{"scan": [0]}])",
        R"("tasks": [{"match": [0], "similarity": [1]}])",
        R"("tasks": [{"scan": [0], "score": [1], "flags": [0], "match": [-2], "similarity": [1]}])",
        R"("tasks": [{"scan": [-1], "score": [1], "flags": [0], "match": [0], "similarity": [1]}])",
        R"("tasks": 3)"}) {
    const auto result = with(scan + file + ", " + bad + "}");
    EXPECT_EQ(result.exit_code, 3) << bad << result.err;
    EXPECT_HAS(result.err, "run.json: ");
  }
}

TEST_F(ReportInABrowser, DrawsTheCurvesWithoutErrors) {
  experiment();
  run_ok("report " + path("out") + " -o " + path("r.html"));

  const std::string dom = drawn(path("r.html"));
  // `data` aligned and not has a legend button and a curve each, and again in the overview.
  EXPECT_HAS(dom, "data, not aligned (AP ");
  EXPECT_HAS(dom, "data-drawn=\"2\"") << "no chart with two curves";

  // The first curve's color covers more than the swatch of its legend (144 pixels).
  browse(path("r.html"), "--window-size=1200,900 --screenshot=" + path("shot.png"));
  EXPECT_GT(pixels_of_color(dir_ / "shot.png", 0x00, 0x72, 0xb2), 400);
  EXPECT_EQ(pixels_of_color(dir_ / "shot.png", 0x12, 0x34, 0x56), 0);
}

TEST_F(ReportInABrowser, DrawsTheMatchesOfARun) {
  evaluate("online,ssc --exclusion frames=60");
  const fs::path page = fs::canonical(dir_ / "results/drive_00/latest/report.html");
  const std::string dom = drawn(page.string());
  // Legends of the map and the histograms of queries and pairs have counts.
  for (const char* legend :
       {">correct \\([0-9]+\\)<", ">scans \\(240\\)<", ">shown below \\([0-9]+\\)<",
        ">best match is correct \\([0-9]+\\)<", ">incorrect pair \\([0-9]+\\)<",
        ">threshold -?[01]\\.[0-9]+<", "src=\"data:image/png;base64,"})
    EXPECT_TRUE(std::regex_search(dom, std::regex(legend))) << legend;

  // Simulates saving a figure.
  std::string html = read_file(page);
  html.insert(html.rfind("</body>"),
              "<script>HTMLAnchorElement.prototype.click = function() {"
              "  document.body.dataset.saved = this.download + ' ' + this.href.slice(0, 22); };"
              "setTimeout(() => document.querySelector('.save').click(), 2000)</script>");
  write_file(dir_ / "saved.html", html);
  const std::string saved = browse(path("saved.html"), "--dump-dom");
  EXPECT_HAS(saved, ".png data:image/png;base64,\"");
}

/// Three scans along a street, the last one at the first's position; then an incomplete line.
constexpr const char* kLoops =
    "{\"frame\":0,\"drive\":\"a\",\"position\":{\"x\":0,\"y\":0,\"z\":0}}\n"
    "{\"frame\":5,\"drive\":\"a\",\"match_drive\":\"a\",\"match_frame\":0,\"score\":0.2,"
    "\"accepted\":false,\"position\":{\"x\":0,\"y\":0,\"z\":40},\"match_position\":{\"x\":0,"
    "\"y\":0,\"z\":0}}\n"
    "{\"frame\":10,\"drive\":\"a\",\"match_drive\":\"a\",\"match_frame\":0,\"score\":0.9,"
    "\"accepted\":true,\"position\":{\"x\":3,\"y\":0,\"z\":0},\"match_position\":{\"x\":0,\"y\":0,"
    "\"z\":0}}\n";

int count_of(const std::string& text, const std::string& part) {
  int n = 0;
  for (size_t at = 0; (at = text.find(part, at)) != std::string::npos; ++at) ++n;
  return n;
}

TEST_F(ReportCommand, LoopsOfAFileThatGrows) {
  write_file(dir_ / "loops.jsonl", std::string(kLoops) + "{\"frame\":1");
  run_ok("report " + path("loops.jsonl") + " -o " + path("r.html"));
  EXPECT_EQ(count_of(read_file(dir_ / "r.html"), "\"frame\":"), 3);
  write_file(dir_ / "loops.csv", "frame,time\n1,2\n");
  expect_exit(3, {"expected the columns score and correct"},
              "report " + path("loops.csv") + " -o " + path("r.html"));
}

/// Stand-ins of a browser and of Rerun's viewer note what they get.
TEST_F(ReportCommand, LoopsAreShownWhileTheyAreFound) {
  const std::string page = path("loops.html"),
                    loops = "loops " + path("drive") + " --view -o " + path("loops.csv");
  // The browser stays open until the page is complete.
  write_file(dir_ / "bin/xdg-open",
             "#!/bin/sh\ncp \"$1\" " + path("opened") +
                 "\nwhile grep -q 'reload_seconds\":' \"$1\"; do sleep 0.1; done\n");
  write_file(dir_ / "bin/python",
             "#!/bin/sh\necho \"$@\" > " + path("words") + "\ncat > " + path("lines") + "\n");
  for (const char* program : {"bin/xdg-open", "bin/python"})
    fs::permissions(dir_ / program, fs::perms::owner_all);
  const std::string search = std::getenv("PATH");
  ::setenv("PATH", (path("bin") + ":" + search).c_str(), 1);
  ::setenv("DISPLAY", ":0", 1);
  ::setenv("REVISIT_PYTHON", path("bin/python").c_str(), 1);
  run_ok(loops + " --rerun --every 2 --sequence 00");
  const std::string words = read_file(dir_ / "words");
  write_file(dir_ / "bin/python", "#!/bin/sh\nexit 3\n");
  expect_exit(1, {"revisit.show` has ended"}, loops + " --rerun --every 2 --sequence 00");
  const size_t reloads = read_file(page).find("reload_seconds\":");  // of a run that failed
  run_ok(loops + " --every 2 --sequence 00");
  ::setenv("PATH", search.c_str(), 1);
  ::unsetenv("DISPLAY");
  ::unsetenv("REVISIT_PYTHON");
  EXPECT_HAS(read_file(dir_ / "opened"), "reload_seconds\":");
  EXPECT_EQ(count_of(read_file(page), "\"frame\":"), 120);
  EXPECT_EQ(read_file(page).find("reload_seconds\":"), std::string::npos);
  EXPECT_EQ(count_of(read_file(dir_ / "lines"), "\n"), 120);
  EXPECT_HAS(words, "-m revisit.show - " + path("drive") + " --sequence=00");
  EXPECT_EQ(reloads, std::string::npos);
  expect_exit(2, {"another ending than .html"}, "loops " + path("drive") + " --view -o " + page);
  write_file(page, "my thesis");
  expect_exit(2, {"is no report"}, loops);
}

TEST_F(ReportInABrowser, DrawsPerturbedQueriesSideBySide) {
  for (const char* feature : {"scan-context", "m2dp"})
    run_ok("eval " + path("drive") + " --perturb none,pitch=5 --queries 3 -q -o " +
           path("results") + " --no-report --feature " + feature);
  run_ok("report " + path("results") + " -o " + path("r.html"));
  const std::string dom = drawn(path("r.html"));
  for (const char* shown : {">00, scan-context: self<", ">00, m2dp: self<", ">pitch=5<"})
    EXPECT_HAS(dom, shown);
  EXPECT_EQ(dom.find("perturbed2"), std::string::npos) << "one table";
}

TEST_F(ReportInABrowser, DrawsTheMapOfLoops) {
  write_file(dir_ / "loops.jsonl", kLoops);
  run_ok("report " + path("loops.jsonl") + " -o " + path("r.html"));
  const std::string dom = drawn(path("r.html"));
  for (const char* shown : {">recognized (1)<", ">scans (3)<", ">not accepted (1)<",
                            ">place of this drive (1)<", ">3.00<"})
    EXPECT_HAS(dom, shown);
}

TEST_F(ReportInABrowser, DrawsAProfile) {
  write_file(dir_ / "net.prototxt",
             "name: '</script>' input: 'data' input_shape { dim: [1, 32, 48, 48] } layer { name: "
             "'conv7' type: 'Convolution' bottom: 'data' top: 'c' convolution_param { num_output: "
             "64 kernel_size: 3 } } layer { name: 'pool7' type: 'Pooling' bottom: 'c' top: 'p' "
             "pooling_param { kernel_size: 2 } }");
  const std::string profile = "net profile " + path("net.prototxt");
  write_file(dir_ / "old.json", run_revisit(profile + " --format json").out);
  const auto page = run_ok(profile + " --format html --baseline " + path("old.json"));
  write_file(dir_ / "r.html", page.out);
  const std::string dom = drawn(path("r.html"));
  for (const char* shown :
       {"Layers of &lt;/script&gt;", ">pool7</td>", ">beyond the limits<", ">layers \\(1\\)<",
        ">memory, [0-9.]+ GB/s<", "data-drawn=\"3\"", "(within noise|faster|slower): "})
    EXPECT_TRUE(std::regex_search(dom, std::regex(shown))) << shown;
}

}  // namespace
}  // namespace revisit
