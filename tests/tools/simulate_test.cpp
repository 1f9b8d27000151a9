#include "testing.h"

namespace revisit::test {
namespace {

std::string quick(const fs::path& output) {
  return "simulate -o '" + output.string() + "' --sensor vlp16 --length 300 --frames 3 ";
}

struct SimulateCommand : testing::Test {
  const TempDir dir;
};

TEST_F(SimulateCommand, WritesADataSetAndTheNextCommand) {
  const auto run = run_ok(quick(dir.path()));
  EXPECT_HAS(run.out, "3 scans");
  EXPECT_HAS(run.out, "revisit eval");
  EXPECT_EQ(run.err, "") << "no progress line when stderr is no terminal";
  for (const char* file : {"poses/00.txt", "sequences/00/calib.txt", "sequences/00/times.txt",
                           "sequences/00/velodyne/000002.bin"})
    EXPECT_TRUE(fs::exists(dir / file)) << file;
  EXPECT_FALSE(fs::exists(dir / "sequences/00/velodyne/000003.bin"));

  const auto again = run_ok(quick(dir.path()));
  EXPECT_HAS(again.out, "3 kept");

  expect_exit(2, {"overwrite"}, quick(dir.path()) + "--seed 9");
}

TEST_F(SimulateCommand, ItsNextCommandWorks) {
  const std::string no_models = "REVISIT_MODELS=/nowhere";
  const auto run = run_ok("simulate -o '" + (dir / "my town").string() +
                              "' --sequence 05 --sensor vlp16 --length 300 --frames 60",
                          no_models);
  const std::string before = "\nnext: revisit ";
  const size_t at = run.out.find(before);
  ASSERT_NE(at, std::string::npos) << run.out;
  const size_t begin = at + before.size();
  const std::string command = run.out.substr(begin, run.out.find('\n', begin) - begin);
  EXPECT_HAS(command, "--sequence 05");
  const ProgramResult next =
      run_revisit(command + " --no-report -o '" + (dir / "results").string() + "'", no_models);
  EXPECT_EQ(next.exit_code, 0) << command << ": " << next.err;
  EXPECT_HAS(next.out, "driving-order");
}

TEST_F(SimulateCommand, FramesAreARangeOrACount) {
  const auto run = run_ok("simulate -q -o '" + dir.path().string() +
                          "' --sensor vlp16 --length 300 --frames 10-14 --every 2");
  EXPECT_EQ(run.out, "");
  for (const int frame : {10, 12, 14})
    EXPECT_TRUE(fs::exists(dir / ("sequences/00/velodyne/0000" + std::to_string(frame) + ".bin")));
  EXPECT_FALSE(fs::exists(dir / "sequences/00/velodyne/000011.bin"));
  for (const char* bad : {"x", "-3", "0", "5-2", "0-99999999", "1-2-3", ""})
    EXPECT_EQ(run_revisit(quick(dir / "bad") + "--frames '" + bad + "'").exit_code, 2) << bad;
}

TEST_F(SimulateCommand, ALimitOnMemoryIsSaid) {
#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)
  GTEST_SKIP() << "the sanitizers map terabytes";
#endif
  expect_exit(1, {"out of memory"}, quick(dir.path()), "ulimit -v 120000; OPENBLAS_NUM_THREADS=1");
}

TEST_F(SimulateCommand, MisuseIsExplained) {
  expect_exit(2, {"--output"}, "simulate");
  expect_exit(2, {"did you mean 'opposite'"}, quick(dir.path()) + "--route opposit");
  expect_exit(2, {"--poses"}, quick(dir.path()) + "--poses p.txt");
  EXPECT_EQ(run_revisit(quick(dir.path()) + "--sensor hdl46").exit_code, 2);
  EXPECT_EQ(run_revisit(quick(dir.path()) + "--seed -1").exit_code, 2);
  expect_exit(
      3, {"no.txt"},
      "simulate -o '" + dir.path().string() + "' --poses '" + (dir / "no.txt").string() + "'");
}

TEST_F(SimulateCommand, ACameraWritesPicturesBesideTheScans) {
  const auto run = run_ok(quick(dir.path()) + "--camera --image-scale 0.1 --light steady");
  EXPECT_HAS(run.out, "each with an image");
  for (const char* frame : {"000000", "000001", "000002"})
    EXPECT_TRUE(fs::exists(dir / ("sequences/00/image_0/" + std::string(frame) + ".png")));
  expect_exit(2, {"needs --camera"}, quick(dir / "other") + "--light steady");
  expect_exit(2, {"did you mean 'steady'"}, quick(dir / "other") + "--camera --light stead");
  EXPECT_EQ(run_revisit(quick(dir / "other") + "--camera --image-scale 2").exit_code, 2);
}

TEST_F(SimulateCommand, SurroundingsAndMountAreSettings) {
  const std::string options =
      "--surroundings old-town --traffic 0.5 --sensor-height 2.1 --sensor-pitch 2 --sensor-roll -1";
  run_ok(quick(dir.path()) + options);
  const std::string settings = read_file(dir / "sequences/00/simulation.txt");
  EXPECT_HAS(settings,
             "surroundings: old-town\ntraffic: 0.5\n"
             "mount: height 2.1, pitch 2, roll -1\n");
  expect_exit(2, {"did you mean 'country'"}, quick(dir / "other") + "--surroundings contry");
  for (const auto& [option, words] : {std::pair("--traffic", "traffic"),
                                      {"--sensor-height", "sensor height"},
                                      {"--sensor-pitch", "sensor pitch"},
                                      {"--sensor-roll", "sensor roll"}}) {
    expect_exit(2, {std::string(words) + " is 99: expected"},
                quick(dir / "other") + option + " 99");
  }
}

TEST_F(SimulateCommand, PresetsAreSetsOfPlaces) {
  const std::string output = "simulate -o '" + (dir / "set").string() + "' ";
  const auto run = run_ok(output + "--preset hkust-rotation");
  EXPECT_HAS(run.out, "77 scans");
  EXPECT_TRUE(fs::exists(dir / "set/place_7/0010.bin"));
  expect_exit(2, {"hkust-objects"}, output + "--preset hkust");
  for (const char* option : {"--camera", "--frames 3", "--sequence 01", "--sensor vlp16",
                             "--surroundings country", "--sensor-height 2"}) {
    expect_exit(2, {"--preset: not with"}, output + "--preset hkust-objects " + option);
  }
}

TEST_F(SimulateCommand, AFolderThatCannotBeWrittenIsAnError) {
  write_file(dir / "file", "");
  expect_exit(1, {"file"}, quick(dir / "file"));
}

}  // namespace
}  // namespace revisit::test
