#include "program_test.h"
#include "revisit/datasets/dataset.h"
#include "revisit/recognition/ring/model.h"
#include "testing.h"

namespace revisit::cli {
namespace {

class Learn : public test::ProgramTest<Learn> {
 public:
  static void fill() {
    run("simulate -o " + path("town") +
        " --sensor vlp16 --route opposite --length 300 --every 12 -q");
    run("models make-random --net ring16 -o " + path("net"));
  }

 protected:
  static std::string learn(const std::string& output, const std::string& more = "") {
    return "train " + path("town") + " --sensor vlp16 -o " + path(output) + " --model " +
           path("net/ring16_random.prototxt") + " --layers pool1=24 " + more;
  }
  /// A program for $REVISIT_PYTHON that streams the scans of a drive as those of a bag.
  static std::string reader_of(const std::string& name) {
    const Dataset drive = open_dataset(path(name), "");
    const std::string begin =
        str("{\"revisit_scans\":1,\"name\":\"bag\",\"count\":", drive.scans.size(), "}\n");
    std::string headers = begin, scans = begin;
    for (const ScanRef& scan : drive.scans) {
      const PointCloud cloud = read_scan(scan);
      const Pose T_world_lidar = axes_of_camera().inverse() * *scan.pose * axes_of_camera();
      std::vector<double> rows;
      for (int i = 0; i < 12; ++i) rows.push_back(T_world_lidar.matrix()(i / 4, i % 4));
      const std::string line = str("{\"frame\":", scan.frame, ",\"source\":\"frame ", scan.frame,
                                   "\",\"pose\":[", joined(rows, ",", exact), "],\"points\":");
      headers += line + "0}\n";
      scans += str(line, cloud.points.size(), "}\n");
      for (const Point& point : cloud.points)
        scans.append(reinterpret_cast<const char*>(&point), 3 * sizeof(float));
    }
    write_file(path("headers"), headers + "{\"end\":true}\n");
    write_file(path("stream"), scans + "{\"end\":true}\n");
    write_file(path("reader"), "#!/bin/sh\necho \"$*\" > " + path("words") +
                                   "\ncase \"$*\" in *headers=True*) cat " + path("headers") +
                                   " ;; *) cat " + path("stream") + " ;; esac\n");
    fs::permissions(path("reader"), fs::perms::owner_all);
    return "REVISIT_PYTHON=" + path("reader");
  }
  static void expect_in(const std::string& text, const std::string& part) {
    EXPECT_HAS(text, part);
  }
};

TEST_F(Learn, EveryLessonGivesAModelThatRecognizesThePlaces) {
  for (const char* lesson : {"loops", "odometry", "sequence", "scans"}) {
    SCOPED_TRACE(lesson);
    const std::string file = std::string(lesson) + ".ring";
    expect_in(run(learn(file, std::string("--from ") + lesson)), file);
    const RingModel model = read_ring_model(path(file));
    EXPECT_EQ(model.image.height, 16);
    EXPECT_EQ(model.cnn.features, 24);
    EXPECT_EQ(model.cnn.shared.empty(), std::string(lesson) == "scans");
    EXPECT_FALSE(model.weights.empty());
    const std::string out = run("eval " + path("town") + " --feature ring --ring " + path(file) +
                                " --exclusion frames=200 --bootstrap 0 --no-report --format json" +
                                " -o " + path("results"));
    expect_in(out, "average_precision");
  }
}

TEST_F(Learn, AModelForTheSensorComesWithTheProgram) {
  const std::string out = run("eval " + path("town") +
                              " --feature ring --exclusion frames=200 --bootstrap 0 --no-report "
                              "--format json -o " +
                              path("results"));
  expect_in(out, "vlp16");
  expect_in(out, "average_precision");
}

TEST_F(Learn, EqualDrivesGiveEqualModels) {
  run(learn("one.ring", "--threads 1"));
  run(learn("two.ring", "--threads 3 --cache " + path("elsewhere")));
  EXPECT_EQ(read_file(path("one.ring")), read_file(path("two.ring")));
}

TEST_F(Learn, ARecordingIsADriveWithATopicAsItsSequence) {
  const std::string environment = reader_of("town"),
                    bag = path("drive.bag") + " --sequence /lidar ";
  write_file(path("drive.bag"), "");
  const auto of_bag = [&](const std::string& command) {
    const ProgramResult result = test::run_revisit(command, environment);
    EXPECT_EQ(result.exit_code, 0) << command << "\n" << result.err;
    EXPECT_HAS(read_file(path("words")), "--sequence=/lidar");
    return result.out;
  };
  const auto train = [&](const std::string& drive, const std::string& file) {
    return "train " + drive + " --sensor vlp16 --augment 0 --layers pool1=8 -q --model " +
           path("net/ring16_random.prototxt") + " -o " + path(file);
  };
  run(train(path("town"), "files.ring"));
  of_bag(train(bag, "bag.ring"));
  const RingModel files = read_ring_model(path("files.ring")),
                  model = read_ring_model(path("bag.ring"));
  EXPECT_EQ(model.cnn.mean, files.cnn.mean);
  EXPECT_EQ(model.polar.shared, files.polar.shared);
  EXPECT_TRUE(model.trained_on.ends_with(" scans of bag")) << model.trained_on;

  const std::string how = " --exclusion frames=200 --target-precision 0.6 --every 1,2 -q ";
  const std::string from_files = run("calibrate " + path("files.ring") + " " + path("town") + how);
  EXPECT_EQ(of_bag("calibrate " + path("bag.ring") + " " + bag + how), from_files);

  write_file(
      path("pairs.csv"), "query,place\n" + [] {
        const Dataset drive = open_dataset(path("town"), "");
        return str(drive.scans.back().frame, ",", drive.scans.front().frame, "\n");
      }());
  EXPECT_HAS(of_bag("eval " + bag + "--pairs " + path("pairs.csv") + " --feature data --pca none" +
                    " --every 24 --no-report -q -o " + path("results")),
             "driving-order");
}

TEST_F(Learn, MistakesAreSaid) {
  expect_in(run(learn("x.ring", "--layers pool1"), 2), "--layers: expected LAYER=N");
  expect_in(run(learn("x.ring", "--layers pool2=4"), 2), "pool2");
  expect_in(run(learn("x.ring", "--layers pool1=4000"), 2), "336 dimensions");
  expect_in(run(learn("x.ring", "--augment -1"), 2), "--augment: expected at least 0, found -1");
  expect_in(run(learn("x.ring", "--radius 0.001"), 2), "pairs of scans are nearer");
  expect_in(run("train -o x.ring", 2), "DATA");
  expect_in(run(learn("none/x.ring"), 1), "there is no folder");
  EXPECT_FALSE(fs::exists(path("none")));
  fs::create_directories(path("scans"));
  for (const auto& entry : fs::directory_iterator(path("town/sequences/00/velodyne")))
    fs::copy(entry.path(), fs::path(path("scans")) / entry.path().filename());
  expect_in(
      run("train " + path("scans") + " -o x.ring --model " + path("net/ring16_random.prototxt"), 2),
      "training from loops or odometry needs poses");
  expect_in(run("eval " + path("town") + " --feature data --ring x", 2), "--feature ring");
  write_file(path("no.ring"), "no model");
  expect_in(run("eval " + path("town") + " --feature ring --ring " + path("no.ring"), 3),
            "not a usable ring model");
  EXPECT_FALSE(fs::exists(path("x.ring")));
}

/// One without a model gets the nearest one.
TEST_F(Learn, ASensorHasItsModelOrTheNearest) {
  run("simulate -o " + path("walk") + " --sensor livox-mid360 --surroundings old-town --route " +
      "opposite --length 300 --every 6 --sensor-height 1 --sensor-pitch 3 -q");
  const std::string walk = run("eval " + path("walk") + " --exclusion meters=50 --format json");
  expect_in(walk, "sensor: livox-mid360 (no separate beams, ");
  EXPECT_GT(std::stod(walk.substr(walk.find("\"recall_at_1\": ") + 15)), 0.95);
  run("simulate -o " + path("hdl32") + " --sensor hdl32 --length 300 --every 90 -q");
  expect_in(run("loops " + path("hdl32") + " --sensor hdl32"),
            "like hdl32; no model for this sensor, the nearest covers");
}

TEST_F(Learn, AModelOfAnotherSensorIsSaid) {
  RingModel model = shipped_ring_model("vlp16");
  model.sensor = "hdl64";
  write_ring_model(path("other.ring"), model);
  const std::string said = "the sensor of these scans looks like vlp16, not hdl64";
  expect_in(run("calibrate " + path("other.ring") + " " + path("town") +
                " --evaluate --augment 0 --exclusion frames=200"),
            said);
  expect_in(run("loops " + path("town") + " --ring " + path("other.ring")), said);
  expect_in(run("train " + path("town") + " -o x.ring --layers none=1 --model " +
                    path("net/ring16_random.prototxt"),
                2),
            said);
  run("simulate -o " + path("hdl64") + " --sensor hdl64 --length 300 --every 300 -q");
  expect_in(run("loops " + path("hdl64") + " --calibrate " + path("town")), said);
}

TEST_F(Learn, ACalibratedModelSaysHowSureItsLoopsAre) {
  run("simulate -o " + path("town2") +
      " --seed 2 --sensor vlp16 --route opposite --length 300 --every 12 -q");
  run(learn("c.ring"));
  const std::string calibrate = "calibrate " + path("c.ring") + " ",
                    same = " --exclusion frames=200 --target-precision 0.6 ";
  expect_in(run(calibrate + path("town2") + " --evaluate", 3), "no calibration");
  const std::string printed = run(calibrate + path("town2") + same + "-q");
  for (const char* part :
       {"unperturbed", "perturbed", "predicted", "threshold for precision 0.6: score"})
    expect_in(printed, part);
  const RingModel model = read_ring_model(path("c.ring"));
  ASSERT_TRUE(model.calibration);
  expect_in(model.calibration->trained_on, "town2");
  EXPECT_EQ(model.calibration->negative_radius, 10);
  const double threshold = model.calibration->threshold_for(0.6).value();
  EXPECT_EQ(run(calibrate + path("town2") + same + "--evaluate").find("sensor"), std::string::npos);
  // Evaluation on the training drive changes nothing and prints equal results.
  const std::string before = read_file(path("c.ring"));
  EXPECT_EQ(run(calibrate + path("town2") + same + "--evaluate -q"), printed);
  EXPECT_EQ(read_file(path("c.ring")), before);
  const std::string found = run("loops " + path("town") + " --ring " + path("c.ring") + same +
                                "--no-verify --all --format jsonl -q");
  int accepted = 0;
  std::istringstream lines(found);
  for (std::string line; std::getline(lines, line);) {
    if (line.find("\"score\"") == std::string::npos) continue;
    const auto value = [&](const std::string& name) {
      const size_t at = line.find("\"" + name + "\":");
      return at == std::string::npos ? -9 : std::stod(line.substr(at + name.size() + 3));
    };
    EXPECT_NEAR(value("probability"), model.calibration->probability(value("score")), 1e-12);
    const bool is_accepted = line.find("\"accepted\":true") != std::string::npos;
    EXPECT_EQ(is_accepted, value("score") >= threshold) << line;
    accepted += is_accepted ? 1 : 0;
  }
  EXPECT_GT(accepted, 5);
  expect_in(run("calibrate " + path("c.ring"), 2), "DRIVE");
  expect_in(run(calibrate + path("town2") + " -o /nowhere/c.ring", 1),
            "there is no folder /nowhere");
  expect_in(run(calibrate + path("town2") + " --target-precision 1", 2), "--target-precision");
  expect_in(run(calibrate + path("town2") + same + "--radius 1e-9", 3), "no match is correct");
  expect_in(run(calibrate + path("town2") + " --exclusion frames=9999", 3), "correct or incorrect");
  EXPECT_EQ(read_file(path("c.ring")), before);
  expect_in(run(calibrate + path("town2") + " --evaluate -o x", 2), "give one of the two");
  expect_in(run(calibrate + path("town2") + " --radius 0", 2), "--radius");
  expect_in(run(calibrate + path("town2/sequences/00/velodyne"), 3), "poses");
}

/// A stub logs the calls of tools/train_ring_models.sh and is killed in its second drive.
TEST(LearnRingModels, GoesOnWithTheDriveOfAKilledRun) {
  const TempDir dir;
  const std::string calls = (dir / "calls").string();
  write_file(dir / "revisit", "#!/bin/sh\necho \"$@\" >>'" + calls +
                                  "'\ncase $1 in\n"
                                  "  simulate) mkdir -p $3; [ $(grep -c simulate '" +
                                  calls +
                                  "') != 2 ] ;;\n"
                                  "  train) exit 1 ;;\nesac\n");
  fs::permissions(dir / "revisit", fs::perms::owner_all);
  const std::string command = "REVISIT='" + (dir / "revisit").string() + "' '" +
                              test::project_file("tools/train_ring_models.sh").string() + "' '" +
                              (dir / "drives").string() + "'";
  EXPECT_NE(std::system(command.c_str()), 0);
  EXPECT_NE(std::system(command.c_str()), 0);
  std::string made;
  std::istringstream lines(read_file(calls));
  for (std::string call; std::getline(lines, call);)
    if (call.starts_with("simulate")) made += call.back();
  EXPECT_EQ(made, "37378") << "seeds";
}

}  // namespace
}  // namespace revisit::cli
