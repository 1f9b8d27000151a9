#include "testing.h"

namespace revisit::test {
namespace {

std::string quick(const fs::path& output) {
  return "simulate -o '" + output.string() + "' --sensor vlp16 --length 300 --frames 3 ";
}

bool has(const std::string& text, const std::string& part) {
  return text.find(part) != std::string::npos;
}

TEST(SimulateCommand, WritesADataSetAndSaysWhatIsNext) {
  const TempDir dir;
  const ProgramResult run = run_revisit(quick(dir.path()));
  ASSERT_EQ(run.exit_code, 0) << run.err;
  EXPECT_TRUE(has(run.out, "3 scans")) << run.out;
  EXPECT_TRUE(has(run.out, "revisit eval")) << run.out;
  EXPECT_EQ(run.err, "") << "no progress line when stderr is no terminal";
  for (const char* file : {"poses/00.txt", "sequences/00/calib.txt", "sequences/00/times.txt",
                           "sequences/00/velodyne/000002.bin"})
    EXPECT_TRUE(fs::exists(dir / file)) << file;
  EXPECT_FALSE(fs::exists(dir / "sequences/00/velodyne/000003.bin"));

  const ProgramResult again = run_revisit(quick(dir.path()));
  EXPECT_EQ(again.exit_code, 0) << again.err;
  EXPECT_TRUE(has(again.out, "3 kept")) << again.out;

  const ProgramResult other = run_revisit(quick(dir.path()) + "--seed 9");
  EXPECT_EQ(other.exit_code, 2);
  EXPECT_TRUE(has(other.err, "overwrite")) << other.err;
}

TEST(SimulateCommand, WhatItSaysIsNextWorks) {
  const TempDir dir;
  const std::string no_models = "REVISIT_MODELS=/nowhere";
  const ProgramResult run =
      run_revisit("simulate -o '" + (dir / "my town").string() +
                      "' --sequence 05 --sensor vlp16 --length 300 --frames 60",
                  no_models);
  ASSERT_EQ(run.exit_code, 0) << run.err;
  const std::string before = "\nnext: revisit ";
  const size_t at = run.out.find(before);
  ASSERT_NE(at, std::string::npos) << run.out;
  const size_t begin = at + before.size();
  const std::string command = run.out.substr(begin, run.out.find('\n', begin) - begin);
  EXPECT_TRUE(has(command, "--sequence 05")) << command;
  const ProgramResult next =
      run_revisit(command + " --no-report -o '" + (dir / "results").string() + "'", no_models);
  EXPECT_EQ(next.exit_code, 0) << command << ": " << next.err;
  EXPECT_TRUE(has(next.out, "driving-order")) << next.out;
}

TEST(SimulateCommand, FramesAreARangeOrACount) {
  const TempDir dir;
  const ProgramResult run = run_revisit("simulate -q -o '" + dir.path().string() +
                                        "' --sensor vlp16 --length 300 --frames 10-14 --every 2");
  ASSERT_EQ(run.exit_code, 0) << run.err;
  EXPECT_EQ(run.out, "");
  for (const int frame : {10, 12, 14})
    EXPECT_TRUE(fs::exists(dir / ("sequences/00/velodyne/0000" + std::to_string(frame) + ".bin")));
  EXPECT_FALSE(fs::exists(dir / "sequences/00/velodyne/000011.bin"));
  for (const char* bad : {"x", "-3", "0", "5-2", "0-99999999", "1-2-3", ""})
    EXPECT_EQ(run_revisit(quick(dir / "bad") + "--frames '" + bad + "'").exit_code, 2) << bad;
}

TEST(SimulateCommand, ALimitOnMemoryIsSaid) {
#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)
  GTEST_SKIP() << "the sanitizers map terabytes";
#endif
  const TempDir dir;
  const ProgramResult run =
      run_revisit(quick(dir.path()), "ulimit -v 120000; OPENBLAS_NUM_THREADS=1");
  EXPECT_EQ(run.exit_code, 1);
  EXPECT_TRUE(has(run.err, "out of memory")) << run.err;
}

TEST(SimulateCommand, MisuseIsExplained) {
  const TempDir dir;
  const ProgramResult no_output = run_revisit("simulate");
  EXPECT_EQ(no_output.exit_code, 2);
  EXPECT_TRUE(has(no_output.err, "--output")) << no_output.err;
  const ProgramResult route = run_revisit(quick(dir.path()) + "--route opposit");
  EXPECT_EQ(route.exit_code, 2);
  EXPECT_TRUE(has(route.err, "did you mean 'opposite'")) << route.err;
  const ProgramResult both = run_revisit(quick(dir.path()) + "--poses p.txt");
  EXPECT_EQ(both.exit_code, 2);
  EXPECT_TRUE(has(both.err, "--poses")) << both.err;
  EXPECT_EQ(run_revisit(quick(dir.path()) + "--sensor hdl46").exit_code, 2);
  EXPECT_EQ(run_revisit(quick(dir.path()) + "--seed -1").exit_code, 2);
  const ProgramResult absent = run_revisit("simulate -o '" + dir.path().string() + "' --poses '" +
                                           (dir / "no.txt").string() + "'");
  EXPECT_EQ(absent.exit_code, 3);
  EXPECT_TRUE(has(absent.err, "no.txt")) << absent.err;
}

TEST(SimulateCommand, ACameraWritesPicturesBesideTheScans) {
  const TempDir dir;
  const ProgramResult run =
      run_revisit(quick(dir.path()) + "--camera --image-scale 0.1 --light steady");
  ASSERT_EQ(run.exit_code, 0) << run.err;
  EXPECT_TRUE(has(run.out, "each with an image")) << run.out;
  for (const char* frame : {"000000", "000001", "000002"})
    EXPECT_TRUE(fs::exists(dir / ("sequences/00/image_0/" + std::string(frame) + ".png")));
  const ProgramResult no_camera = run_revisit(quick(dir / "other") + "--light steady");
  EXPECT_EQ(no_camera.exit_code, 2);
  EXPECT_TRUE(has(no_camera.err, "needs --camera")) << no_camera.err;
  const ProgramResult light = run_revisit(quick(dir / "other") + "--camera --light stead");
  EXPECT_EQ(light.exit_code, 2);
  EXPECT_TRUE(has(light.err, "did you mean 'steady'")) << light.err;
  EXPECT_EQ(run_revisit(quick(dir / "other") + "--camera --image-scale 2").exit_code, 2);
}

TEST(SimulateCommand, SurroundingsAndMountAreSettings) {
  const TempDir dir;
  const std::string options =
      "--surroundings old-town --traffic 0.5 --sensor-height 2.1 --sensor-pitch 2 --sensor-roll -1";
  const ProgramResult run = run_revisit(quick(dir.path()) + options);
  ASSERT_EQ(run.exit_code, 0) << run.err;
  const std::string settings = read_file(dir / "sequences/00/simulation.txt");
  EXPECT_TRUE(has(settings,
                  "surroundings: old-town\ntraffic: 0.5\n"
                  "mount: height 2.1, pitch 2, roll -1\n"))
      << settings;
  const ProgramResult name = run_revisit(quick(dir / "other") + "--surroundings contry");
  EXPECT_EQ(name.exit_code, 2);
  EXPECT_TRUE(has(name.err, "did you mean 'country'")) << name.err;
  for (const auto& [option, words] : {std::pair("--traffic", "traffic"),
                                      {"--sensor-height", "sensor height"},
                                      {"--sensor-pitch", "sensor pitch"},
                                      {"--sensor-roll", "sensor roll"}}) {
    const ProgramResult far = run_revisit(quick(dir / "other") + option + " 99");
    EXPECT_EQ(far.exit_code, 2);
    EXPECT_TRUE(has(far.err, std::string(words) + " is 99: expected")) << far.err;
  }
}

TEST(SimulateCommand, PresetsAreSetsOfPlaces) {
  const TempDir dir;
  const std::string output = "simulate -o '" + (dir / "set").string() + "' ";
  const ProgramResult run = run_revisit(output + "--preset hkust-rotation");
  ASSERT_EQ(run.exit_code, 0) << run.err;
  EXPECT_TRUE(has(run.out, "77 scans")) << run.out;
  EXPECT_TRUE(fs::exists(dir / "set/place_7/0010.bin"));
  const ProgramResult name = run_revisit(output + "--preset hkust");
  EXPECT_EQ(name.exit_code, 2);
  EXPECT_TRUE(has(name.err, "hkust-objects")) << name.err;
  for (const char* option : {"--camera", "--frames 3", "--sequence 01", "--sensor vlp16",
                             "--surroundings country", "--sensor-height 2"}) {
    const ProgramResult both = run_revisit(output + "--preset hkust-objects " + option);
    EXPECT_EQ(both.exit_code, 2);
    EXPECT_TRUE(has(both.err, "--preset: not with")) << both.err;
  }
}

TEST(SimulateCommand, AFolderThatCannotBeWrittenIsAnError) {
  const TempDir dir;
  write_file(dir / "file", "");
  const ProgramResult run = run_revisit(quick(dir / "file"));
  EXPECT_EQ(run.exit_code, 1);
  EXPECT_TRUE(has(run.err, "file")) << run.err;
}

}  // namespace
}  // namespace revisit::test
