// A script replaces the Python package that reads recordings.
#include "loops/recording.h"

#include <signal.h>
#include <sys/wait.h>
#include <unistd.h>

#include "testing.h"

namespace revisit::cli {
namespace {

constexpr const char* kHeader = "{\"revisit_scans\":1,\"name\":\"drive\",\"count\":2}\n";
constexpr const char* kEnd = "{\"end\":true}\n";

std::string bytes_of(const std::vector<float>& values) {
  return {reinterpret_cast<const char*>(values.data()), values.size() * sizeof(float)};
}

std::string two_points(int frame) {
  return str("{\"frame\":", frame, ",\"time\":7.5,\"source\":\"f", frame,
             "\",\"points\":2,\"times\":true,\"pose\":[0,-1,0,1,1,0,0,2,0,0,1,3]}\n",
             bytes_of({1, 2, 3, 4, 5, 6, 0.25F, 0.5F}));
}

std::vector<ScanRef> all_of(const std::string& stream) {
  std::istringstream in(stream);
  const RecordedScans scans = recorded_scans(in, "S");
  std::vector<ScanRef> found;
  while (auto scan = scans.next()) found.push_back(*scan);
  return found;
}

TEST(RecordedScans, HavePointsTimesAndPoses) {
  const std::vector<ScanRef> scans = all_of(kHeader + two_points(3) + two_points(5) + kEnd);
  ASSERT_EQ(scans.size(), 2U);
  EXPECT_EQ(scans[1].frame, 5);
  EXPECT_EQ(scans[1].time, 7.5);
  EXPECT_EQ(scans[1].file, "f5");
  EXPECT_EQ(scans[1].pose->translation(), Eigen::Vector3d(1, 2, 3));
  EXPECT_EQ(scans[1].pose->linear()(1, 0), 1);
  const PointCloud cloud = read_scan(scans[0]);
  ASSERT_EQ(cloud.points.size(), 2U);
  EXPECT_EQ(cloud.points[1].y, 5);
  EXPECT_EQ(cloud.times, (std::vector<float>{0.25F, 0.5F}));
}

TEST(RecordedScans, CanBeSpooledAndReadSeveralTimes) {
  std::istringstream in(kHeader + two_points(0) +
                        "{\"frame\":1,\"source\":\"f1\",\"error\":\"f1: corrupt\"}\n" +
                        two_points(2) + kEnd);
  const Dataset dataset = spooled(recorded_scans(in, "S"));
  EXPECT_EQ(dataset.name, "drive");
  EXPECT_EQ(dataset.n_poses, 2);
  ASSERT_EQ(dataset.scans.size(), 3U);
  for (int pass = 0; pass < 2; ++pass) {
    EXPECT_EQ(read_scan(dataset.scans[2]).points[0].z, 3);
    EXPECT_EQ(read_scan(dataset.scans[0]).times[1], 0.5F);
    EXPECT_THROW(read_scan(dataset.scans[1]), InputError);
  }
  EXPECT_EQ(dataset.scans[0].checksum, dataset.scans[2].checksum);
  EXPECT_TRUE(with_sensor_poses(dataset)[0].pose->isApprox(
      *all_of(kHeader + two_points(0) + kEnd)[0].pose));
}

TEST(RecordedScans, AreNeverShortenedSilently) {
  const std::string stream = kHeader + two_points(0) + two_points(1) + kEnd;
  for (size_t bytes = 0; bytes < stream.size(); ++bytes)
    EXPECT_THROW(all_of(stream.substr(0, bytes)), InputError) << bytes;
  EXPECT_EQ(all_of(stream).size(), 2U);
}

TEST(RecordedScans, RejectAnotherFormat) {
  EXPECT_THROW(all_of(str("{\"revisit_scans\":2}\n", kEnd)), InputError);
  EXPECT_THROW(all_of("hello\n"), InputError);
  EXPECT_THROW(all_of(str(kHeader, "{\"frame\":0,\"pose\":[1,2]}\n", kEnd)), InputError);
  EXPECT_THROW(all_of(str(kHeader, "{\"frame\":0,\"points\":4000000000}\n", kEnd)), InputError);
  EXPECT_THROW(all_of(str(kHeader, "{\"error\":\"x\",\"code\":2}\n")), UsageError);
  EXPECT_THROW(all_of("{\"error\":\"x\",\"code\":3}\n"), InputError);
}

class Recording : public testing::Test {
 protected:
  Recording() { write_file(bag(), "#ROSBAG V2.0"); }
  std::string bag() const { return (dir_ / "drive.bag").string(); }
  std::string reader() const { return (dir_ / "reader").string(); }
  void install(const std::string& script) const {
    write_file(reader(), "#!/bin/sh\n" + script);
    fs::permissions(reader(), fs::perms::owner_all);
  }
  test::ProgramResult run(const std::string& arguments) const {
    return test::run_revisit(arguments, "REVISIT_PYTHON=" + reader());
  }

  TempDir dir_;
};

TEST(Recordings, AreFoundByTheirLayout) {
  const TempDir dir;
  for (const char* name :
       {"a.bag", "a.db3", "a.mcap", "a.pcap", "a.osf", "ros2/metadata.yaml", "parts/1.bag",
        "mulran/Ouster/1.bin", "helipr/LiDAR/Velodyne/1.bin", "nclt/velodyne_sync/1.bin",
        "k360/data_3d_raw/d", "drive/velodyne_points/data/1.bin", "nu/v1.0-mini/x",
        "nu2/samples/LIDAR_TOP/1.pcd.bin", "nu3/1.pcd.bin", "arrays/1.npy"}) {
    fs::create_directories((dir / name).parent_path());
    write_file(dir / name, "");
    const std::string top = name;
    EXPECT_TRUE(is_recording(dir / top.substr(0, top.find('/')))) << name;
  }
  for (const char* name : {"kitti/sequences/00/velodyne/0.bin", "plain/0.bin", "places/one/0.pcd",
                           "both/0.npy", "both/0.ply"}) {
    fs::create_directories((dir / name).parent_path());
    write_file(dir / name, "");
  }
  for (const char* name : {"kitti", "plain", "places", "both", "nowhere", "plain/0.bin"})
    EXPECT_FALSE(is_recording(dir / name)) << name;
}

TEST_F(Recording, IsStreamedWithTheOptionsOfTheReader) {
  std::vector<float> points;
  for (int i = 0; i < 3000; ++i) {
    const float angle = static_cast<float>(i) * 0.01F;
    const float range = 10 + 3 * std::sin(3 * angle);
    points.insert(points.end(), {range * std::cos(angle), range * std::sin(angle),
                                 static_cast<float>(i % 7) * 0.3F - 1});
  }
  std::string stream = kHeader;
  for (int frame = 0; frame < 2; ++frame)
    stream += str("{\"frame\":", frame, ",\"source\":\"drive.bag, frame ", frame,
                  "\",\"points\":3000}\n", bytes_of(points));
  write_file(dir_ / "stream", stream + kEnd);
  install("shift 2; echo \"$*\" > " + (dir_ / "words").string() + "; cat " +
          (dir_ / "stream").string() + "\n");
  const std::string options = " --sensor hdl64 --threshold 9 --all --no-verify --format jsonl";
  const auto result =
      run("loops " + bag() + " --sequence '/a b' --every 2 --point-times us" + options);
  EXPECT_EQ(result.exit_code, 0) << result.err;
  EXPECT_EQ(std::ranges::count(result.out, '\n'), 2) << result.out;
  EXPECT_HAS(result.out, "\"file\":\"drive.bag, frame 1\"");
  EXPECT_EQ(read_file(dir_ / "words"),
            "--every=2 --sequence=/a b --point-times=us -- " + bag() + "\n");
}

TEST_F(Recording, IsExaminedByDoctor) {
  write_file(dir_ / "stream", kHeader + two_points(0) + kEnd);
  install("cat " + (dir_ / "stream").string() + "\n");
  const auto result = run("doctor " + bag());
  EXPECT_EQ(result.exit_code, 0) << result.err;
  EXPECT_EQ(result.out, "  recording         1 scan, 1 pose, times\n");
}

TEST_F(Recording, ErrorsOfTheReaderAreTheProgramsErrors) {
  const auto expect = [&](const std::string& script, int code, const std::string& message) {
    install(script);
    const auto result = run("loops " + bag());
    EXPECT_EQ(result.exit_code, code) << script;
    EXPECT_EQ(result.out, "");
    EXPECT_HAS(result.err, "revisit: " + message);
  };
  expect("echo '{\"error\":\"no topic /r\",\"code\":2}'; exit 2\n", 2, "no topic /r");
  expect("echo '{\"error\":\"needs the package rosbags\",\"code\":1}'; exit 1\n", 1,
         "needs the package rosbags");
  expect("exit 9\n", 3,
         bag() + ": the stream ends too early, after 0 scans; its reader exited with code 9");
  expect("echo '" + std::string(kHeader, strlen(kHeader) - 1) + "'; kill -9 $$\n", 3,
         bag() + ": the stream ends too early, after 0 scans; its reader was killed by signal 9");
  fs::remove(reader());
  const auto result = run("loops " + bag());
  EXPECT_EQ(result.exit_code, 3);
  EXPECT_HAS(result.err, "cannot be started");
}

TEST_F(Recording, CtrlCEndsBothProcesses) {
  const std::string ready = (dir_ / "ready").string(), ended = (dir_ / "ended").string();
  install("trap 'echo > " + ended + "; exit 0' INT\necho $$ > " + ready +
          "\nwhile :; do sleep 0.1; done\n");
  const pid_t child = ::fork();
  if (child == 0) {
    ::setenv("REVISIT_PYTHON", reader().c_str(), 1);
    ::execl(REVISIT_PROGRAM, "revisit", "loops", bag().c_str(), nullptr);
    ::_exit(1);
  }
  for (int i = 0; i < 3000 && !fs::exists(ready); ++i)
    std::this_thread::sleep_for(std::chrono::milliseconds(10));
  ::kill(child, SIGINT);
  int status = 0;
  ASSERT_EQ(::waitpid(child, &status, 0), child);
  EXPECT_TRUE(WIFEXITED(status));
  EXPECT_EQ(WEXITSTATUS(status), 130);
  EXPECT_TRUE(fs::exists(ended));
  EXPECT_NE(::kill(std::stoi(read_file(ready)), 0), 0) << "the reader still runs";
}

}  // namespace
}  // namespace revisit::cli
