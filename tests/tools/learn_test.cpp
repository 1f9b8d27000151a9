// `revisit learn` and what --feature ring makes of it.
#include <gtest/gtest.h>

#include "revisit/recognition/ring/model.h"
#include "test_data.h"

namespace revisit::cli {
namespace {

namespace fs = std::filesystem;

/// A street driven down and back up, seen by the quick sensor, and its network.
class Learn : public testing::Test {
 protected:
  static void SetUpTestSuite() {
    folder_ = new test::TempDir;
    run("simulate -o " + path("town") +
        " --sensor vlp16 --route opposite --length 300 --every 12 -q");
    run("models make-random --net ring16 -o " + path("net"));
  }
  static void TearDownTestSuite() {
    delete folder_;
    folder_ = nullptr;
  }

  static std::string path(const std::string& name) { return (*folder_ / name).string(); }
  static std::string run(const std::string& command, int expected = 0) {
    const auto result = test::run_revisit(command);
    EXPECT_EQ(result.exit_code, expected) << command << "\n" << result.err;
    return result.out + result.err;
  }
  static std::string learn(const std::string& output, const std::string& more = "") {
    return "learn " + path("town") + " --sensor vlp16 -o " + path(output) + " --model " +
           path("net/ring16_random.prototxt") + " --layers pool1=24 --no-progress " + more;
  }
  static void expect_in(const std::string& text, const std::string& part) {
    EXPECT_NE(text.find(part), std::string::npos) << "no \"" << part << "\" in: " << text;
  }

  static test::TempDir* folder_;
};
test::TempDir* Learn::folder_ = nullptr;

TEST_F(Learn, EveryLessonGivesAModelThatRecognisesThePlaces) {
  for (const char* lesson : {"loops", "odometry", "sequence", "scans"}) {
    SCOPED_TRACE(lesson);
    const std::string file = std::string(lesson) + ".ring";
    expect_in(run(learn(file, std::string("--from ") + lesson)), file);
    const pipeline::RingModel model = pipeline::read_ring_model(path(file));
    EXPECT_EQ(model.image.height, 16);
    EXPECT_EQ(model.columns.numbers, 24);
    EXPECT_EQ(model.columns.shared.empty(), std::string(lesson) == "scans");
    EXPECT_FALSE(model.weights.empty());
    const std::string out = run("eval " + path("town") + " --feature ring --ring " + path(file) +
                                " --exclusion frames=200 --bootstrap 0 --no-report --format json" +
                                " --no-progress -o " + path("results"));
    expect_in(out, "average_precision");
  }
}

TEST_F(Learn, AModelForTheSensorComesWithTheProgram) {
  const std::string out = run("eval " + path("town") +
                              " --feature ring --exclusion frames=200 --bootstrap 0 --no-report "
                              "--format json --no-progress -o " +
                              path("results"));
  expect_in(out, "vlp16");
  expect_in(out, "average_precision");
}

TEST_F(Learn, EqualDrivesGiveEqualModels) {
  run(learn("one.ring", "--threads 1"));
  run(learn("two.ring", "--threads 3 --cache " + path("elsewhere")));
  EXPECT_EQ(test::read_file(path("one.ring")), test::read_file(path("two.ring")));
}

TEST_F(Learn, MistakesAreSaid) {
  expect_in(run(learn("x.ring", "--layers pool1"), 2), "--layers: expected LAYER=N");
  expect_in(run(learn("x.ring", "--layers pool2=4"), 2), "pool2");
  expect_in(run(learn("x.ring", "--layers pool1=4000"), 2), "336 numbers");
  expect_in(run(learn("x.ring", "--altered -1"), 2), "--altered: expected at least 0, found -1");
  expect_in(run(learn("x.ring", "--columns-share 1.5"), 2), "--columns-share: expected 0 to 1");
  expect_in(run(learn("x.ring", "--radius 0.001"), 2), "pairs of scans are nearer");
  expect_in(run("learn -o x.ring", 2), "DATA");
  fs::create_directories(path("scans"));
  for (const auto& entry : fs::directory_iterator(path("town/sequences/00/velodyne")))
    fs::copy(entry.path(), fs::path(path("scans")) / entry.path().filename());
  expect_in(
      run("learn " + path("scans") + " -o x.ring --model " + path("net/ring16_random.prototxt"), 2),
      "--from loops and odometry need poses");
  expect_in(run("eval " + path("town") + " --feature ring --sensor hdl32", 2),
            "no ring model for the sensor 'hdl32'; there are models for hdl64, vlp16");
  expect_in(run("eval " + path("town") + " --feature data --ring x", 2), "--feature ring");
  test::write_file(path("no.ring"), "no model");
  expect_in(run("eval " + path("town") + " --feature ring --ring " + path("no.ring"), 3),
            "not a usable ring model");
  EXPECT_FALSE(fs::exists(path("x.ring")));
}

}  // namespace
}  // namespace revisit::cli
