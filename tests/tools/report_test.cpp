// `revisit report`: the file itself, and what a browser makes of it.
#include <gtest/gtest.h>
#include <png.h>
#include <sys/stat.h>

#include <algorithm>
#include <cstdlib>
#include <future>
#include <regex>

#include "report/base64.h"
#include "report/html.h"
#include "report/page.h"
#include "report/range_images.h"
#include "small_drive.h"
#include "test_data.h"

namespace revisit {
namespace {

namespace fs = std::filesystem;
using test::run_revisit;

TEST(Base64, VectorsOfRfc4648) {
  const std::pair<const char*, const char*> vectors[] = {{"", ""},
                                                         {"f", "Zg=="},
                                                         {"fo", "Zm8="},
                                                         {"foo", "Zm9v"},
                                                         {"foob", "Zm9vYg=="},
                                                         {"fooba", "Zm9vYmE="},
                                                         {"foobar", "Zm9vYmFy"}};
  for (const auto& [bytes, text] : vectors) EXPECT_EQ(cli::base64(bytes), text);
  EXPECT_EQ(cli::base64("\xff\xfe\xfd"), "//79");
}

TEST(HtmlPage, NothingInTheDataBecomesMarkup) {
  reports::Page page;
  page.set_title("</title><script>alert(1)</script>");
  page.add_runs()->set_title("</script><script>alert(2)</script><!--");
  const std::string html = cli::html_page(page);
  EXPECT_EQ(html.find("alert(1)</script>"), std::string::npos);
  EXPECT_EQ(html.find("</script><script>alert(2)"), std::string::npos);
  EXPECT_EQ(html.find("<!--"), std::string::npos);
  EXPECT_NE(html.find("&lt;/title&gt;&lt;script&gt;"), std::string::npos);
  EXPECT_NE(html.find("\\u003c/script\\u003e"), std::string::npos);
}

TEST(HtmlPage, NeedsNothingFromTheNetwork) {
  const std::string html = cli::html_page({});
  for (const char* reference : {"src=\"http", "href=\"http", "@import", "url(http"})
    EXPECT_EQ(html.find(reference), std::string::npos) << reference;
}

/// How many pixels of a PNG have exactly this colour; -1 when it cannot be read.
int64_t pixels_of_colour(const fs::path& file, int red, int green, int blue) {
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

std::string find_browser() {
  for (const char* name : {"chromium", "chromium-browser", "google-chrome"})
    if (std::system(("command -v " + std::string(name) + " >/dev/null 2>&1").c_str()) == 0)
      return name;
  return "";
}

class ReportCommand : public testing::Test {
 protected:
  ReportCommand() { test::write_small_drive(dir_ / "drive", 240); }
  std::string path(const std::string& name) const { return (dir_ / name).string(); }
  void experiment() const {
    // KITTI's 00 of which only the first scans are there.
    const fs::path poses = dir_ / "drive/poses/00.txt";
    std::string lines = test::read_file(poses);
    for (int frame = 240; frame < 4541; ++frame) lines += "1 0 0 0 0 1 0 0 0 0 1 0\n";
    test::write_file(poses, lines);
    fs::create_directory(dir_ / "models");
    const auto result =
        run_revisit("experiment alignment comparison --kitti " + path("drive") + " --models " +
                    path("models") + " --width 100 -o " + path("out"));
    ASSERT_EQ(result.exit_code, 0) << result.err;
  }
  /// Runs the browser on a page and returns what it printed, standard error first.
  std::string browse(const std::string& browser, const std::string& page,
                     const std::string& options) const {
    const std::string command = "HOME=" + path("home") + " timeout 120 " + browser +
                                " --headless --no-sandbox --disable-gpu --disable-dev-shm-usage "
                                "--hide-scrollbars --virtual-time-budget=10000 "
                                "--enable-logging=stderr " +
                                options + " 'file://" + page + "' > " + path("stdout") + " 2> " +
                                path("stderr");
    EXPECT_EQ(std::system(command.c_str()), 0) << test::read_file(dir_ / "stderr");
    return test::read_file(dir_ / "stderr") + test::read_file(dir_ / "stdout");
  }

  const test::TempDir dir_;
};

TEST_F(ReportCommand, WhatCannotBeWrittenIsRefusedBeforeAnyWork) {
  fs::create_directory(dir_ / "folder");
  fs::create_directory(dir_ / "empty");
  const std::pair<std::string, const char*> refused[] = {
      {"-o " + path("folder"), "is a folder"},
      {"-o " + path("r.html") + " --markdown " + path("folder"), "is a folder"},
      {"-o " + path("r.html") + " --markdown " + path("folder/../r.html"), "is the HTML file"}};
  for (const auto& [options, reason] : refused) {
    const auto result = run_revisit("report " + path("empty") + " " + options);
    EXPECT_EQ(result.exit_code, 2) << options << result.err;
    EXPECT_NE(result.err.find(reason), std::string::npos) << options << result.err;
  }
  for (const char* made : {"folder_files", "r_files", "r.html"})
    EXPECT_FALSE(fs::exists(dir_ / made)) << made;
}

TEST_F(ReportCommand, ToAPipeGoesThePageOnly) {
  ASSERT_EQ(run_revisit("eval " + path("drive") +
                        " --feature data --width 100 --protocol "
                        "online --exclusion frames=60 --no-plots -o " +
                        path("results"))
                .exit_code,
            0);
  ASSERT_EQ(::mkfifo((dir_ / "fifo").c_str(), 0600), 0);
  const fs::path before = fs::current_path();
  fs::current_path(dir_.path());                 // the figures go to report_files
  fs::create_symlink("/proc/self/fd/1", "out");  // as /dev/stdout, which a fault would destroy
  const auto page = run_revisit("report results --no-plots -o out");
  auto reader =
      std::async(std::launch::async, [] { return std::system("timeout 60 cat fifo > copy.html"); });
  const auto piped = run_revisit("report results --no-plots -o fifo");
  EXPECT_EQ(reader.get(), 0);
  fs::current_path(before);
  EXPECT_EQ(page.exit_code, 0) << page.err;
  EXPECT_TRUE(page.out.starts_with("<!") && page.out.ends_with("</html>\n")) << page.err;
  EXPECT_EQ(piped.exit_code, 0) << piped.err;
  EXPECT_TRUE(fs::is_fifo(dir_ / "fifo"));
  EXPECT_TRUE(test::read_file(dir_ / "copy.html").ends_with("</html>\n"));
  EXPECT_FALSE(fs::exists(dir_ / "fifo_files"));
}

TEST_F(ReportCommand, OneFileOfARunWithItsFigures) {
  ASSERT_EQ(run_revisit("eval " + path("drive") +
                        " --feature data --width 100 --protocol "
                        "online --exclusion frames=60 --no-plots -o " +
                        path("results"))
                .exit_code,
            0);
  const auto result =
      run_revisit("report " + path("results") + " -o " + path("r.html") + " --title '<b>x</b>'");
  ASSERT_EQ(result.exit_code, 0) << result.err;
  const std::string html = test::read_file(dir_ / "r.html");
  EXPECT_NE(html.find("data:image/png;base64,"), std::string::npos) << "no range image";
  EXPECT_NE(html.find("revisit eval " + path("drive")), std::string::npos) << "no command";
  EXPECT_EQ(html.find("<b>x</b>"), std::string::npos);
  for (const char* figure : {"run1_online_map.gp", "run1_online_scores.gp"})
    EXPECT_TRUE(fs::exists(dir_ / "r_files" / figure)) << figure;

  // The bound on images holds, and scans that are gone are no error.
  fs::remove_all(dir_ / "drive/sequences/00/velodyne");
  const auto without =
      run_revisit("report " + path("results") + " --no-plots -o " + path("s.html"));
  EXPECT_EQ(without.exit_code, 0) << without.err;
  EXPECT_NE(without.err.find("range images are missing"), std::string::npos) << without.err;
  EXPECT_EQ(test::read_file(dir_ / "s.html").find("data:image/png"), std::string::npos);
}

TEST_F(ReportCommand, ImagesAreBounded) {
  ASSERT_EQ(run_revisit("eval " + path("drive") +
                        " --feature data --width 100 --protocol "
                        "online --exclusion frames=60 --no-plots -o " +
                        path("results"))
                .exit_code,
            0);
  const auto result = run_revisit("report " + path("results") +
                                  " --no-plots --image-mb 0 --title 'A B' -o " + path("r.html"));
  EXPECT_NE(result.err.find("--image-mb"), std::string::npos) << result.err;
  const std::string html = test::read_file(dir_ / "r.html");
  EXPECT_EQ(html.find("data:image/png"), std::string::npos);
  EXPECT_NE(html.find("--title 'A B' -o"), std::string::npos) << "its command is for a shell";
}

TEST_F(ReportCommand, ImagesOfTheSameFrameElsewhereHaveTheirOwnFile) {
  reports::RunInfo info;
  info.set_sequence("00");
  info.set_align("none");
  info.set_image_width(100);
  info.set_image_height(112);
  info.set_elevation_top_deg(3);
  info.set_elevation_bottom_deg(-25);
  info.set_max_range_m(80);
  info.set_closing_width(5);
  info.set_closing_height(3);
  fs::create_directories(dir_ / "files");
  cli::RangeImages images(dir_ / "files", 1'000'000);
  const fs::path scans = dir_ / "drive/sequences/00/velodyne";
  for (const char* file : {"000001.bin", "000002.bin"})  // as if each were frame 1 of its town
    EXPECT_NE(images.add(scans / file, 1, info, false), "") << images.warning();
  EXPECT_EQ(std::distance(fs::directory_iterator(dir_ / "files"), {}), 2);
}

TEST_F(ReportCommand, MarkdownHasTheCommandBesideEachNumber) {
  experiment();
  ASSERT_EQ(run_revisit("report " + path("out") + " --no-plots -o " + path("r.html") +
                        " --markdown " + path("docs/RESULTS.md"))
                .exit_code,
            0);
  const std::string text = test::read_file(dir_ / "docs/RESULTS.md");
  EXPECT_NE(text.find("## With and without alignment"), std::string::npos) << text;
  EXPECT_NE(text.find("![Comparison with other methods, 00](../r_files/comparison_00.svg)"),
            std::string::npos)
      << text;
  const size_t row = text.find("| 00 | data, aligned | ");
  ASSERT_NE(row, std::string::npos) << text;
  // AP [low, high]
  EXPECT_TRUE(std::regex_search(text.substr(row, 60),
                                std::regex("aligned \\| [01]\\.[0-9]{3} \\[[01]\\.[0-9]{2}, ")))
      << text.substr(row, 60);
  EXPECT_NE(text.find("`revisit eval " + path("drive")), std::string::npos) << text;
  EXPECT_NE(text.find("sequence 05 is not there"), std::string::npos) << text;
}

/// A run on three scans with one task, still without queries.
cli::ReportData one_task() {
  cli::ReportData data;
  cli::ReportRun& run = data.runs.emplace_back();
  run.info.set_align("none");
  run.scans.resize(3);
  run.tasks.emplace_back();
  return data;
}

TEST_F(ReportCommand, MatchesThatAreNeitherRightNorWrongAreNotShownAsWrong) {
  cli::ReportData data = one_task();
  cli::ReportTask& task = data.runs[0].tasks[0];
  task.queries.resize(2);
  for (cli::ReportQuery& query : task.queries) {
    query.matches = {2};
    query.similarities = {0.5};
    query.accepted = true;
  }
  task.queries[0].ignored = true;
  task.queries[1].scan = 1;
  cli::PageOptions options;
  options.files = dir_ / "files";
  options.no_plots = true;
  const reports::Page page = cli::make_page(data, options);
  const reports::PageTask& shown = page.runs(0).tasks(0);
  EXPECT_EQ(shown.flags(0), 1 + 8);
  EXPECT_EQ(shown.flags(1), 1);
  ASSERT_EQ(shown.shown_size(), 1);
  EXPECT_EQ(shown.shown(0).kind(), "wrong");
  EXPECT_EQ(shown.shown(0).scan(), 1);
}

TEST_F(ReportCommand, TheMapShowsWhatTheRunAccepted) {
  // The score in the file is rounded below the threshold, as files of earlier versions have it.
  cli::ReportData data = one_task();
  cli::ReportTask& task = data.runs[0].tasks[0];
  task.metrics.set_protocol("online");
  task.metrics.set_f1_max_threshold(0.62320303359);
  cli::ReportQuery& query = task.queries.emplace_back();
  query.matches = {2};
  query.similarities = {0.5};
  query.score = 0.623203;
  query.accepted = query.correct = query.positive = true;
  cli::PageOptions options;
  options.files = dir_ / "files";
  const reports::Page page = cli::make_page(data, options);
  EXPECT_EQ(page.runs(0).tasks(0).flags(0), 1 + 2 + 4);
  const std::string script = test::read_file(dir_ / "files/run1_online_map.gp");
  EXPECT_NE(script.find("right (1)"), std::string::npos) << script;
  EXPECT_EQ(script.find("missed"), std::string::npos) << script;
}

TEST_F(ReportCommand, WhatIsNoRunIsRefused) {
  const auto none = run_revisit("report " + path("drive") + " -o " + path("r.html"));
  EXPECT_EQ(none.exit_code, 3);
  EXPECT_NE(none.err.find("neither a run"), std::string::npos) << none.err;
  test::write_file(dir_ / "bad/experiment.json", "{\"runs\": 3}");
  EXPECT_EQ(run_revisit("report " + path("bad") + " -o " + path("r.html")).exit_code, 3);
  EXPECT_FALSE(fs::exists(dir_ / "r.html"));
}

TEST_F(ReportCommand, OnlyReportsAreReplaced) {
  experiment();
  const std::string report =
      "report " + path("out") + " --no-plots -o " + path("r.html") + " --markdown " + path("r.md");
  ASSERT_EQ(run_revisit(report).exit_code, 0);
  EXPECT_EQ(run_revisit(report).exit_code, 0) << "a report may be made again";
  for (const char* file : {"r.html", "r.md"}) {
    const std::string ours = test::read_file(dir_ / file);
    test::write_file(dir_ / file, "my thesis");
    const auto refused = run_revisit(report);
    EXPECT_EQ(refused.exit_code, 2);
    EXPECT_NE(refused.err.find("--force"), std::string::npos) << refused.err;
    EXPECT_EQ(test::read_file(dir_ / file), "my thesis");
    EXPECT_EQ(run_revisit(report + " --force").exit_code, 0);
    EXPECT_NE(test::read_file(dir_ / file), "my thesis");
  }
}

TEST_F(ReportCommand, NamesOfAForeignRunLeadNowhereElse) {
  ASSERT_EQ(run_revisit("eval " + path("drive") +
                        " --feature data --width 100 --protocol online --exclusion frames=60 "
                        "--no-plots -o " +
                        path("results"))
                .exit_code,
            0);
  const fs::path run = fs::canonical(dir_ / "results/drive_00/latest");
  const auto with = [&](const char* file, const std::string& from, const std::string& to) {
    const std::string text = test::read_file(run / file);
    std::string changed = text;
    changed.replace(changed.find(from), from.size(), to);
    test::write_file(run / file, changed);
    auto result = run_revisit("report " + path("results") + " -o " + path("r.html"));
    test::write_file(run / file, text);
    return result;
  };
  for (const std::string name : {"a/../../pwn", "</script>", "..", "a\\nb"}) {
    const auto result =
        with("metrics.json", "\"protocol\": \"online\"", "\"protocol\": \"" + name + "\"");
    EXPECT_EQ(result.exit_code, 3) << name << result.err;
    EXPECT_NE(result.err.find("metrics.json: protocol"), std::string::npos) << result.err;
  }
  EXPECT_EQ(with("run.json", "\"sequence\": \"00\"", "\"sequence\": \"../00\"").exit_code, 3);
  for (const char* bad :
       {R"({"name": "../../pwn"})", R"({"name": "x", "runs": [{"panel": "a/b"}]})"}) {
    test::write_file(dir_ / "bad/experiment.json", bad);
    EXPECT_EQ(run_revisit("report " + path("bad") + " -o " + path("r.html")).exit_code, 3) << bad;
  }
}

TEST_F(ReportCommand, ABrowserDrawsTheCurvesWithoutErrors) {
  const std::string browser = find_browser();
  if (browser.empty()) GTEST_SKIP() << "no browser here (Debian: chromium)";
  if (!cli::has_plot_library()) GTEST_SKIP() << "built without libjs-chart.js";
  experiment();
  ASSERT_EQ(run_revisit("report " + path("out") + " --no-plots -o " + path("r.html")).exit_code, 0);

  const std::string dom = browse(browser, path("r.html"), "--dump-dom");
  EXPECT_EQ(dom.find("CONSOLE"), std::string::npos)
      << dom.substr(dom.find("CONSOLE"), 500);  // an error, or anything else it complains about
  // A legend button and a drawn curve each: `data` aligned and not, once more in the overview.
  EXPECT_NE(dom.find("data, not aligned (AP "), std::string::npos);
  EXPECT_NE(dom.find("data-drawn=\"2\""), std::string::npos) << "no chart with two curves";

  // The first curve's colour is really on the screen, beyond the swatch of its legend (144 pixels).
  browse(browser, path("r.html"), "--window-size=1200,900 --screenshot=" + path("shot.png"));
  EXPECT_GT(pixels_of_colour(dir_ / "shot.png", 0x00, 0x72, 0xb2), 400);
  EXPECT_EQ(pixels_of_colour(dir_ / "shot.png", 0x12, 0x34, 0x56), 0);
}

}  // namespace
}  // namespace revisit
