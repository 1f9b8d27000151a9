#include <poll.h>
#include <sys/inotify.h>
#include <unistd.h>

#include "loops/loop_outputs.h"
#include "loops/loop_writer.h"
#include "program_test.h"
#include "revisit/datasets/dataset.h"
#include "revisit/maps/map_store.h"
#include "revisit/recognition/ring/descriptor.h"
#include "testing.h"

namespace revisit::cli {
namespace {

class Loops : public test::ProgramTest<Loops> {
 public:
  static void fill() {
    for (const char* seed : {"1", "2"})
      run("simulate -o " + path(std::string("town") + seed) + " --seed " + seed +
          " --sensor vlp16 --route opposite --length 400 --every 12 -q");
  }

 protected:
  static std::string run(const std::string& command, int expected = 0) {
    return result_of(command, expected).out;
  }
  static std::string loops(const std::string& more) {
    return "loops " + path("town1") + " --exclusion frames=150 -q " + more;
  }
  static std::vector<std::string> split(const std::string& text, char at) {
    std::vector<std::string> result;
    std::istringstream in(text);
    for (std::string line; std::getline(in, line, at);) result.push_back(line);
    return result;
  }
  static std::vector<std::string> lines(const std::string& text) { return split(text, '\n'); }
};

TEST_F(Loops, AreFoundAtTheThresholdOfAnotherTownAndNoneIsWrong) {
  const std::vector<std::string> found = lines(run(loops("-o - --calibrate " + path("town2"))));
  ASSERT_GT(found.size(), 5) << "no loops";
  EXPECT_TRUE(found[0].starts_with("frame,time,match_drive,match_frame"));
  // Ground truth: x, z of each frame.
  std::ifstream poses(*folder_ / "town1/poses/00.txt");
  std::vector<std::pair<double, double>> at;
  for (std::string line; std::getline(poses, line);) {
    std::istringstream numbers(line);
    std::vector<double> p{std::istream_iterator<double>(numbers), {}};
    at.emplace_back(p[3], p[11]);
  }
  for (size_t i = 1; i < found.size(); ++i) {
    std::istringstream cells(found[i]);
    std::string frame, time, drive, match;
    std::getline(cells, frame, ',');
    std::getline(cells, time, ',');
    std::getline(cells, drive, ',');
    std::getline(cells, match, ',');
    const auto a = at.at(std::stoul(frame)), b = at.at(std::stoul(match));
    // Calibrations count entries from 10 m on as different.
    EXPECT_LT(std::hypot(a.first - b.first, a.second - b.second), 10) << found[i];
  }
}

TEST_F(Loops, AHaltCountsOnceInACalibration) {
  std::vector<fs::path> scans;
  for (const auto& scan : fs::directory_iterator(path("town2/sequences/00/velodyne")))
    scans.push_back(scan.path());
  std::ranges::sort(scans);
  const fs::path standing = scans.at(16);
  scans.insert(scans.begin() + 16, 60, standing);
  const std::vector<std::string> poses = lines(read_file(path("town2/poses/00.txt")));
  fs::create_directories(path("halt/sequences/00/velodyne"));
  fs::create_directories(path("halt/poses"));
  std::ofstream out(path("halt/poses/00.txt"));
  for (size_t i = 0; i < scans.size(); ++i) {
    fs::create_symlink(scans[i], path("halt/sequences/00/velodyne/" + std::to_string(i) + ".bin"));
    out << poses.at(std::stoul(scans[i].stem())) << "\n";
  }
  out.close();
  const auto threshold = [](const std::string& drive) {
    const std::string said =
        result_of(
            "loops " + path("town1") + " --exclusion meters=100 " + "--calibrate " + path(drive), 0)
            .err;
    return said.substr(said.find("a score of at least"), 25);
  };
  EXPECT_EQ(threshold("halt"), threshold("town2"));
}

TEST_F(Loops, ResumeAMapWithItsThreshold) {
  const std::string whole = run(loops("--calibrate " + path("town2") + " --map " + path("a.map")));
  const std::string info = run("map info " + path("a.map"));
  EXPECT_HAS(info, "town2");
  EXPECT_HAS(run("map info --check " + path("a.map")), "valid");
  const size_t entries = lines(run("map info --entries " + path("a.map"))).size() - 1;
  // A second drive of equal scans recognizes the first.
  const std::vector<std::string> again =
      lines(run(loops("--drive second --format jsonl --map " + path("a.map"))));
  EXPECT_GT(again.size(), entries * 9 / 10);
  EXPECT_HAS(again[0], "\"match_drive\":\"00\"");
  EXPECT_EQ(lines(run("map info --entries " + path("a.map"))).size() - 1, 2 * entries);
  // Names may be invalid UTF-8, JSON may not; no part of the line is lost.
  const auto latin = test::run_revisit(loops("--drive Stra\xdf' 'e --all --format jsonl"));
  EXPECT_HAS(latin.out, "\"drive\":\"Stra\uFFFD e\"");
  EXPECT_EQ(latin.err.find("libprotobuf"), std::string::npos) << latin.err;
}

TEST_F(Loops, WarnOfCalibrationsForOtherLoops) {
  const std::string map = " --map " + path("score.map");
  run(loops("--no-verify --calibrate " + path("town2") + map));
  const auto said = [&](const std::string& more) { return result_of(loops(more + map), 0).err; };
  EXPECT_HAS(said(""), "for loops without registration");
  EXPECT_EQ(said("--no-verify"), "");
  EXPECT_EQ(said("--threshold 1"), "");
  open_map(path("score.map"), MapAccess::kWrite)->set_value(kVerifiedCalibrationValue, "nonsense");
  EXPECT_HAS(said(""), "ignored; calibrate the map again");
  EXPECT_HAS(run("map info --check " + path("score.map"), 5), "verified calibration: not a usable");
  EXPECT_HAS(run("map info " + path("score.map")), "corrupt");
  std::string bytes = read_file(path("score.map"));  // now its checksum does not fit, too
  for (size_t at = 0; (at = bytes.find("nonsense", at)) != std::string::npos;) bytes[at] = 'N';
  write_file(path("score.map"), bytes);
  EXPECT_HAS(run("map info " + path("score.map")), "corrupt");
}

TEST_F(Loops, RejectMapsOfOtherLocalMaps) {
  const std::string map = " --map " + path("local.map") + " --every 40 ";
  const std::string first = result_of("loops " + path("town1") + map + "--local-map 10", 0).err;
  EXPECT_HAS(first, "sensor: hdl64 (of local maps)");
  expect_exit(3, {"local map: the map has '10 m', this program none"},
              loops("--sensor hdl64" + map));
  const auto query = test::run_revisit("locate " + path("local.map") + " " +
                                       path("town1/sequences/00/velodyne/000000.bin"));
  EXPECT_EQ(query.exit_code, 0);
  EXPECT_HAS(query.err, "local.map: has local maps of 10 m; give accumulated clouds");
  EXPECT_EQ(lines(query.out).size(), 2);
}

TEST_F(Loops, OfMergedMaps) {
  const std::string town2 = "loops " + path("town2") + " --threshold 0 -q ";
  run(loops("--threshold 0 --warmup 30 --map " + path("one.map")));
  run(town2 + "--map " + path("two.map") + " --projection-from " + path("one.map") + " --drive 2");
  run("map merge " + path("one.map") + " " + path("two.map") + " -o " + path("both.map"));
  const auto entries = [](const std::string& map) {
    return lines(run("map info --entries " + path(map))).size() - 1;
  };
  EXPECT_EQ(entries("both.map"), entries("one.map") + entries("two.map"));
  const std::string scan = "/sequences/00/velodyne/000024.bin";
  const std::vector<std::string> found =
      lines(run("locate " + path("both.map") + " --sensor vlp16 --threshold 0.5 -q " +
                path("town2") + scan + " " + path("town1") + scan));
  ASSERT_EQ(found.size(), 3);
  EXPECT_TRUE(found[1].starts_with("0,,2,24,")) << found[1];
  EXPECT_TRUE(found[2].starts_with("1,,00,24,")) << found[2];
  EXPECT_HAS(run("locate " + path("both.map") + " --sensor vlp16 -q --every 24 " + path("town2")),
             ",2,24,");
}

/// Of a map of another drive through the town, whose poses have the same world.
TEST_F(Loops, LocateScansInTheWorldOfTheMap) {
  run("map build " + path("town1") + " --map " + path("there.map") + " --warmup 30 -q");
  const std::string before = read_file(path("there.map"));
  std::string scans;
  for (int frame = 108; frame < 228; frame += 12)
    scans += str(" ", path("town1/sequences/00/velodyne/000"), frame, ".bin");
  const std::vector<std::string> found =
      lines(run("locate " + path("there.map") + " -q --format jsonl" + scans));
  ASSERT_EQ(found.size(), 10) << "none fits another place";
  for (const std::string& line : found) {
    EXPECT_HAS(line, "\"accepted\":true");
    EXPECT_HAS(line, "\"pose\":{");
    EXPECT_HAS(line, "\"covariance\":[");
  }
  write_file(path("none.bin"), "");
  expect_exit(6, {"none.bin: empty file"}, "locate " + path("there.map") + " " + path("none.bin"));
  EXPECT_EQ(read_file(path("there.map")), before) << "nothing is written";
}

TEST_F(Loops, OutputsReplaceNoInput) {
  const std::string kept = path("kept.map"), twice = path("twice.txt");
  run("map build " + path("town1") + " --every 40 --map " + kept + " -q");
  const std::string before = read_file(kept);
  for (const std::string& line :
       {"map export " + kept + " --tum " + kept,
        "map export " + kept + " --g2o " + path("town1/../kept.map"),
        "map export " + kept + " --g2o " + twice + " --tum " + twice,
        "loops " + path("town1") + " --map " + kept + " -o " + kept,
        "loops " + path("town1") + " --poses " + twice + " --pose-frame lidar --tum " + twice})
    expect_exit(2, {"is the file of", "would be overwritten"}, line);
  EXPECT_EQ(read_file(kept), before);
  EXPECT_FALSE(fs::exists(twice));
}

/// A room of 30 x 20 m with a pillar, as a cloud far from its origin.
TEST_F(Loops, MapsOfCloudsHaveVirtualScans) {
  std::string points, y_down;  // y_down: in a camera's axes
  int n = 0;
  const auto add = [&](double x, double y, double z) {
    points += str(x + 500, " ", y - 300, " ", z + 20, "\n");
    y_down += str(300 - y, " ", -z, " ", x + 500, "\n");
    ++n;
  };
  const auto write = [&](const std::string& name) {
    write_file(path(name), str("FIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nWIDTH ", n,
                               "\nHEIGHT 1\nDATA ascii\n", points));
  };
  for (double a = 0; a < 30; a += 0.1)
    for (double b = 0; b < 20; b += 0.1) {
      add(a, b, 0);
      if (b >= 4) continue;
      add(a, 0, b);
      add(a, a < 12 ? 20 : 17, b);
      if (a < 20) add(0, a, b);
      if (a < 17) add(30, a, b);
      if (a < 4) add(8 + a, 6, b);
    }
  write("site.pcd");
  for (double a = 2; a < 28; a += 0.1)  // a car passed, and a door was opened
    for (double b = 7; b < 13; b += 0.1) {
      add(a, b, 1.4);
      if (a < 4 && b < 9) add(a, 14.5, b - 7);
    }
  write("trails.pcd");
  const std::string build =
      "map build --from-cloud " + path("site.pcd") + " -q --sensor vlp16 --map ";
  run(build + path("site.map"));
  const size_t entries = lines(run("map info --entries " + path("site.map"))).size() - 1;
  EXPECT_GT(entries, 10);
  EXPECT_LT(entries, 50);
  run("map build --from-cloud " + path("trails.pcd") + " -q --sensor vlp16 --map " +
      path("trails.map"));
  EXPECT_EQ(lines(run("map info --entries " + path("trails.map"))).size() - 1, entries);
  write_file(path("way.tum"), "0 506.3 -291.1 21.7 0 0 0 1\n1 506.4 -291.1 21.7 0 0 0 1\n");
  run(build + path("way.map") + " --poses " + path("way.tum"));
  EXPECT_HAS(run("map info --entries " + path("way.map")), "506.300,-291.100,21.700");
  expect_exit(2, {"--from-cloud"}, "map build " + path("site.pcd") + " --map x.map --poses y");
  points = y_down;
  write("y_down.pcd");
  expect_exit(0, {"y_down.pcd: y seems to be up or down, because 5", "rotate the cloud"},
              "map build --from-cloud " + path("y_down.pcd") + " --map " + path("y_down.map"));
  write_file(path("utm.pcd"),
             "FIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nWIDTH 1\nHEIGHT 1\n"
             "DATA ascii\n500000 5400000 20\n");
  expect_exit(3, {"beyond 131 km", "subtract an origin"},
              "map build --from-cloud " + path("utm.pcd") + " --map x.map");
}

TEST_F(Loops, MapsKeepTheirDtype) {
  const std::string build =
      "map build " + path("town1") + " --every 40 --feature m2dp --map " + path("half.map");
  run(build + " --dtype float16");
  EXPECT_HAS(run(build), "0 added by this process");
  EXPECT_HAS(run(build + " --dtype float16"), "0 added by this process");
  expect_exit(3, {"--dtype float32", "half.map has float16"}, build + " --dtype float32");
  expect_exit(2, {"--candidates"}, build + " --candidates 5");
}

TEST_F(Loops, EntriesAreRemoved) {
  const std::string map = path("changing.map");
  {
    const MapFingerprint fingerprint{{"feature", "x"}};
    std::vector<MapEntry> entries(8);  // 10 m apart
    const double times[] = {1, 2, 90'000, 1.7e9, 1.7e9, 1.7e9, 1.7e9, 1.7e9};
    for (size_t i = 0; i < entries.size(); ++i) {
      entries[i].drive = i < 3 ? "monday" : "friday";
      entries[i].time = times[i];
      entries[i].pose.emplace(Eigen::Translation3d(10.0 * static_cast<double>(i), 0, 5));
      entries[i].descriptor = {1};
    }
    entries[7].cloud = "no points of a scan";
    open_map(map, MapAccess::kWrite, &fingerprint)->add(entries);
  }
  EXPECT_HAS(run("map info --check " + map, 5), "entry 8: a place's points are corrupt");
  const auto remove = [&](const std::string& which) {
    return run("map remove " + map + " " + which);
  };
  // Ages are counted by the clock of the given drives.
  EXPECT_HAS(remove("--dry-run --older 1 --drive monday"), ": 2 of 8 entries would be removed");
  EXPECT_HAS(remove("--dry-run --older 1 --drive friday"), ": 0 of 8 entries would");
  EXPECT_HAS(remove("--dry-run --older 1"), ": 3 of 8 entries would");
  EXPECT_HAS(remove("--dry-run --near=31,0,5 --radius 12"), ": 3 of 8 entries would");
  const auto nothing = result_of("map remove " + map + " --near=9e9,0,0 --radius 1", 0);
  EXPECT_HAS(nothing.out, ": 0 of 8 entries");
  EXPECT_HAS(nothing.err, "no entry meets all conditions");
  expect_exit(2, {"no entries of 'mondays' (did you mean 'monday'?); its drives: friday, monday"},
              "map remove " + map + " --near=31,0,5 --radius 12 --drive mondays");
  EXPECT_HAS(remove("--near=31,0,5 --radius 12 --drive friday"), ": 2 of 8 entries were removed");
  EXPECT_HAS(remove("--ids 1,7-8"), ": 3 of 6 entries were removed");
  EXPECT_HAS(remove("--ids 1,7-8"), ": 0 of 3 entries");
  EXPECT_HAS(remove("--older @3"), ": 1 of 3 entries were removed");
  EXPECT_HAS(remove("--drive monday"), ": 1 of 2 entries were removed");
  EXPECT_TRUE(lines(run("map info --entries " + map)).at(1).starts_with("6,friday,0,"));
  EXPECT_HAS(run("map info --check " + map), "valid");
  for (const char* wrong :
       {"remove", "remove --near 1,2,3", "remove --near 1,2 --radius 3", "remove --ids 9999",
        "remove --ids 3-1", "remove --ids x", "remove --older @x", "remove --older -1"})
    run("map " + std::string(wrong) + " " + map, 2);
}

TEST_F(Loops, MapsAreBuiltFromMissingScans) {
  const auto built = [](const std::string& more, int expected = 0) {
    return run("map build " + path("town2") + " --warmup 30 --map " + more, expected);
  };
  const auto entries_in = [](const std::string& map) {
    return lines(run("map info --entries " + path(map))).size() - 1;
  };
  built(path("b.map") + " --every 60");
  const size_t some = entries_in("b.map");
  const std::string rest = built(path("b.map"));
  const size_t entries = entries_in("b.map");
  EXPECT_GT(some, 5);
  EXPECT_HAS(rest, std::to_string(entries - some) + " added by this process");
  EXPECT_HAS(built(path("b.map")), " 0 added by this process");
  EXPECT_HAS(run("map info --check " + path("b.map")), "valid");
  run("loops " + path("town2") + " --threshold 2 --warmup 30 -q --map " + path("c.map"));
  const auto poses = [](const std::string& map) {
    std::set<std::string> result;
    for (const std::string& line : lines(run("map info --entries " + path(map))))
      result.insert(line.substr(line.find(',')));
    return result;
  };
  EXPECT_EQ(poses("b.map"), poses("c.map"));
  // A scan that cannot be described adds no entry.
  fs::copy(path("town2"), path("broken"), fs::copy_options::recursive);
  write_file(path("broken/sequences/00/velodyne/000012.bin"), "");
  expect_exit(6, {"000012.bin"},
              "map build " + path("broken") + " --sensor vlp16 --map " + path("d.map"));
  EXPECT_EQ(entries_in("d.map"), entries - 1);
}

TEST_F(Loops, ScansAreListedOrComeToAFolder) {
  const std::string town = path("town1/sequences/00/velodyne");
  std::vector<fs::path> scans;
  for (const auto& entry : fs::directory_iterator(town)) scans.push_back(entry.path());
  std::ranges::sort(scans);
  {
    std::ofstream list(*folder_ / "list.txt");
    for (const fs::path& scan : scans) list << scan.string() << "\r\n";  // as on Windows
  }
  const std::string options = " --exclusion frames=300 --threshold 0 --drive town -q";
  const std::string listed = path("listed.csv");
  const auto detect = [&](const std::string& more) {
    const std::string command = std::string("'") + REVISIT_PROGRAM + "' loops - " + options + more +
                                " -o '" + listed + "' < '" + path("list.txt") + "'";
    return std::system(command.c_str());
  };
  EXPECT_NE(detect(" --sequence 00"), 0);
  for (const char* more : {" --every 5 --all", " --all --no-verify"}) {
    ASSERT_EQ(detect(more), 0);
    EXPECT_EQ(read_file(listed), run("loops " + town + options + more)) << more;
  }
  ASSERT_EQ(detect(""), 0);
  fs::create_directory(*folder_ / "growing");
  for (const fs::path& scan : scans) fs::copy_file(scan, *folder_ / "growing" / scan.filename());
  const std::string grown = run("loops " + path("growing") + " --follow 0.5" + options);
  EXPECT_EQ(lines(grown).size(), lines(read_file(listed)).size());
  EXPECT_GT(lines(grown).size(), 5);
}

TEST_F(Loops, ADriveThatIsFollowedIsKeptAsAWholeOne) {
  const std::string options = " --sequence 00 --every 24 --threshold 2 -q ";
  run("loops " + path("town1") + options + "--map " + path("whole.map"));
  run("loops " + path("town1") + options + "--follow 0.3 --map " + path("followed.map"));
  const std::string entries = run("map info --entries " + path("followed.map"));
  EXPECT_GT(lines(entries).size(), 20);
  EXPECT_EQ(entries, run("map info --entries " + path("whole.map")));
  fs::copy(path("town1"), path("short"), fs::copy_options::recursive);
  const std::vector<std::string> poses = lines(read_file(path("short/poses/00.txt")));
  write_file(path("short/poses/00.txt"), poses[0] + "\n" + poses[1] + "\n");
  expect_exit(3, {"holds 2 poses"}, "loops " + path("short") + " --follow 0.3");
}

TEST_F(Loops, IncompleteFilesOfAGrowingDriveAreReadLater) {
  const fs::path drive = path("momentarily"), sequence = drive / "sequences/00";
  fs::create_directories(sequence / "velodyne");
  for (const char* scan : {"000000.bin", "000001.bin", "000002.bin"})
    fs::copy(path("town1/sequences/00/velodyne/000000.bin"), sequence / "velodyne" / scan);
  // Thousands of files make one listing of the folder take milliseconds.
  for (int i = 0; i < 3000; ++i) write_file(sequence / "velodyne" / str("note", i), "");
  // Only the second listing finds invalid times. An open file stays readable when another takes its
  // name.
  const fs::path looks[] = {sequence / "times.txt", drive / "second", drive / "others"};
  const int opened = ::inotify_init();
  int files[std::size(looks)];
  for (size_t i = 0; i < std::size(looks); ++i) {
    write_file(looks[i], i == 1 ? "0\nno time\n2\n" : "0\n1\n2\n");
    files[i] = ::inotify_add_watch(opened, looks[i].c_str(), IN_OPEN);
  }
  std::thread writer([&] {
    for (size_t i = 0; i + 1 < std::size(looks); ++i) {
      inotify_event event{};
      while (event.wd != files[i] || event.mask != IN_OPEN) {
        pollfd soon{opened, POLLIN, 0};
        ASSERT_EQ(::poll(&soon, 1, 20'000), 1) << "no look at the drive";
        ASSERT_EQ(::read(opened, &event, sizeof event), static_cast<ssize_t>(sizeof event));
      }
      fs::rename(looks[i + 1], looks[0]);
    }
  });
  const auto result =
      test::run_revisit("loops " + drive.string() + " --follow 3 --threshold 2 --all -q");
  writer.join();
  ::close(opened);
  EXPECT_EQ(result.exit_code, 0) << result.err;
  EXPECT_EQ(lines(result.out).size(), 1 + 3) << result.out;
}

TEST(LoopWriter, FramesMayBeTimeStamps) {
  Visit visit;
  visit.found.loop.emplace().frame = 1700000000123456789;
  for (const auto& [format, cell] : {std::pair("csv", ",1700000000123456789,"),
                                     std::pair("jsonl", "\"match_frame\":1700000000123456789,")}) {
    std::ostringstream out;
    LoopWriter(out, format).write(line_of(visit, ""));
    EXPECT_HAS(out.str(), cell);
  }
}

TEST(LoopWriter, SaysWhyItCannotWrite) {
  for (const std::string format : {"csv", "jsonl"}) {
    std::ofstream full("/dev/full");
    test::expect_error<Error>([&] { LoopWriter(full, format).write({}); },
                              {"cannot write the loops: No space left on device"});
  }
}

TEST_F(Loops, RegisteredOnesSayWhereTheScansWere) {
  const auto result =
      run_ok(loops("--threshold 0 --tum " + path("r.tum") + " --g2o " + path("r.g2o")));
  const size_t found = lines(result.out).size() - 1;
  const std::vector<std::string> trajectory = lines(read_file(path("r.tum")));
  ASSERT_GT(found, 5);
  EXPECT_EQ(trajectory.size(), found);
  std::map<int, std::vector<double>> positions;  // frame -> x, y, z
  run("loops " + path("town1") + " --threshold 2 -q --map " + path("poses.map"));
  for (const std::string& line : lines(run("map info --entries " + path("poses.map")))) {
    std::istringstream cells(line);
    std::vector<std::string> c;
    for (std::string cell; std::getline(cells, cell, ',');) c.push_back(cell);
    if (c[0] != "id")
      positions[std::stoi(c[2])] = {std::stod(c[4]), std::stod(c[5]), std::stod(c[6])};
  }
  // Simulated drives have 10 frames a second.
  for (const std::string& line : trajectory) {
    std::istringstream numbers(line);
    const std::vector<double> p{std::istream_iterator<double>(numbers), {}};
    ASSERT_EQ(p.size(), 8);
    const std::vector<double>& truth = positions.at(static_cast<int>(std::lround(p[0] * 10)));
    for (size_t axis = 0; axis < 3; ++axis) EXPECT_NEAR(p[axis + 1], truth[axis], 0.5) << line;
  }
  const std::string graph = read_file(path("r.g2o"));
  EXPECT_TRUE(graph.starts_with("VERTEX_SE3:QUAT 0 ")) << graph.substr(0, 100);
  const std::vector<std::string> rows = lines(graph);
  const auto edges = std::ranges::count_if(
      rows, [](const std::string& row) { return row.starts_with("EDGE_SE3:QUAT"); });
  EXPECT_EQ(static_cast<size_t>(edges), positions.size() - 1 + found);
}

/// Poses in a z-up world, as odometry has it: lines, graph, trajectory and map have them, too.
TEST_F(Loops, WriteAllPosesInTheWorldOfTheGivenOnes) {
  const std::string velodyne = path("town1/sequences/00/velodyne"),
                    calib = " --calib " + path("town1/sequences/00/calib.txt");
  const auto positions = [&](const std::string& command) {
    std::vector<std::string> here;
    for (const std::string& line : lines(run(command + " --threshold 2 --all -q --format jsonl"))) {
      const size_t at = line.find("\"position\"");
      here.push_back(line.substr(at, line.find("}", at) - at));
    }
    return here;
  };
  const std::vector<std::string> known = positions("loops " + path("town1"));
  EXPECT_EQ(positions("loops " + velodyne + " --poses " + path("town1/poses/00.txt") +
                      " --pose-frame camera" + calib),
            known);
  std::ifstream times(*folder_ / "town1/sequences/00/times.txt");
  TrajectoryWriter writer(*folder_ / "lidar.tum");
  const Pose T_cam_lidar = read_kitti_calibration(*folder_ / "town1/sequences/00/calib.txt");
  for (const Pose& pose : read_kitti_poses(*folder_ / "town1/poses/00.txt")) {
    double time = 0;
    ASSERT_TRUE(times >> time);
    writer.add(time, axes_of_camera().inverse() * pose * T_cam_lidar);
  }
  const std::string given = " --poses " + path("lidar.tum") + " --pose-frame lidar";
  const TimedPoses truth = read_timed_poses(path("lidar.tum"));
  const std::string with_map = " --map " + path("world.map") + " --g2o " + path("world.g2o");
  const std::vector<std::string> here = positions("loops " + path("town1") + given + with_map);
  std::vector<std::string> graph = lines(read_file(path("world.g2o")));
  std::erase_if(graph, [](const std::string& row) { return !row.starts_with("VERTEX"); });
  const std::vector<std::string> entries = lines(run("map info --entries " + path("world.map")));
  ASSERT_EQ(std::tuple(here.size(), graph.size(), entries.size() - 1),
            std::tuple(known.size(), known.size(), known.size()));
  for (size_t i = 0; i < here.size(); ++i) {
    const auto frame = std::stoul(split(entries[i + 1], ',')[2]);
    const Eigen::Vector3d t = truth.poses[frame].translation();
    for (int axis = 0; axis < 3; ++axis) {
      const std::string json = here[i].substr(here[i].find(str('"', "xyz"[axis], "\":")) + 4);
      EXPECT_NEAR(std::stod(json), t[axis], 1e-5) << here[i];
      EXPECT_NEAR(std::stod(split(graph[i], ' ')[2 + axis]), t[axis], 1e-5) << graph[i];
      EXPECT_NEAR(std::stod(split(entries[i + 1], ',')[4 + axis]), t[axis], 1e-3) << entries[i + 1];
    }
    const std::vector<std::string> cells = split(entries[i + 1], ',');
    EXPECT_TRUE(
        graph[i].ends_with(str("  # frame ", frame, " time ", cells[3], " drive ", cells[1])))
        << graph[i];
  }
  const Eigen::Vector3d last = truth.poses[std::stoul(split(entries.back(), ',')[2])].translation();
  const std::string near = str(last.x(), ",", last.y(), ",", last.z(), " --radius 0.1 --dry-run");
  EXPECT_HAS(run("map remove " + path("world.map") + " --near " + near),
             str("1 of ", known.size(), " entries would be removed"));
  run("loops " + path("town1") + given + " -q --exclusion frames=150 --tum " + path("out.tum"));
  const TimedPoses out = read_timed_poses(path("out.tum"));
  ASSERT_GT(out.times.size(), 3);
  for (size_t i = 0; i < out.times.size(); ++i) {
    const auto at =
        std::ranges::lower_bound(truth.times, out.times[i] - 0.01) - truth.times.begin();
    const Eigen::Vector3d apart = out.poses[i].translation() - truth.poses[at].translation();
    EXPECT_LT(apart.norm(), 0.5) << out.times[i];
  }
}

TEST_F(Loops, RejectInvalidOptions) {
  const auto fails = [](const std::string& command, int code, const std::string& part) {
    expect_exit(code, {part}, command);
  };
  fails(loops("--threshold 1 --calibrate " + path("town2")), 2, "one of the two");
  fails(loops("--threshold 1 --target-precision 0.9"), 2, "one of the two");
  fails(loops("--target-precision 0.99999"), 2, "no threshold reaches it; the best precision");
  fails(loops("--feature scan-context --target-precision 0.9"), 2, "not calibrated");
  fails(loops("--target-precision 2"), 2, "--target-precision");
  fails(loops("--exclusion years=2"), 2, "exclusion");
  fails(loops("--cache x"), 2, "--cache");
  fails(loops("--warmup 1"), 2, "warm-up: expected at least 2");
  fails(loops("--feature fabmap"), 2, "camera images");
  fails(loops("--no-verify --g2o x.g2o"), 2, "--no-verify: not with --g2o; give one of the two");
  for (const char* option : {"--g2o x.g2o", "--tum x.tum"})
    fails(loops(str("--no-clouds ", option)), 2, "--no-clouds: not with --");
  std::ofstream(path("kept.tum")) << "kept";
  fails(loops("--feature m2dp --threshold 0 --tum " + path("kept.tum")), 2, "no relative yaw");
  EXPECT_EQ(read_file(path("kept.tum")), "kept");
  const std::string poses = " --poses " + path("town1/poses/00.txt");
  fails(loops(poses), 2, "--pose-frame");
  fails(loops("--max-gap -1"), 2, "--max-gap");
  fails(loops("--pose-frame lidar"), 2, "--pose-frame: needs --poses");
  fails(loops(poses + " --pose-frame camera --follow 1"), 2, "--follow");
  fails(loops("--poses /nowhere --pose-frame camera"), 3, "/nowhere");
  fails("map build " + path("town1"), 2, "--map");
  fails(loops("-o /nowhere/x.csv"), 1, "/nowhere/x.csv");
  fails(loops("--g2o /nowhere/x.g2o -o " + path("kept.tum")), 1, "/nowhere/x.g2o");
  EXPECT_EQ(read_file(path("kept.tum")), "kept");
  fails("loops /nowhere", 3, "/nowhere");
  fails("locate x.map /nowhere.bin", 3, "x.map: there is no such map");
  fails("locate x.map x.bin --threshold 1 --target-precision 0.9", 2, "one of the two");
  fails("map info /nowhere.map", 3, "/nowhere.map");
}

TEST(LoopSummary, CountsRejections) {
  LoopSummary summary(parse_exclusion("frames=5"), 0.6);
  EXPECT_EQ(summary.text(),
            "0 scans, 0 loops accepted: no scan had a candidate (exclusion frames=5)");
  const auto add = [&](double score, const std::string& rejection) {
    Detection found{.loop = Loop{}, .rejection = rejection};
    found.loop->score = score;
    found.accepted = rejection.empty();
    summary.add(found);
  };
  summary.add({});
  add(0.4, "score");
  EXPECT_EQ(summary.text(),
            "2 scans, 0 loops accepted: the best score of 1 query is 0.4 (threshold 0.6); 1 scan "
            "had no candidate (exclusion frames=5)");
  add(0.7, "score");
  add(0.7, "similarity");
  add(0.8, "ambiguous");
  for (const char* why : {"registration", "contradicted", "hidden", "odometry", "inconsistent"})
    add(0.8, why);
  add(0.8, "no points");
  add(0.9, "");
  summary.add({.error = "the scan has no points"});
  summary.add({.loop = Loop{}, .accepted = true, .questioned = {7}});
  EXPECT_EQ(summary.questioned(), std::vector<int64_t>{7});
  EXPECT_EQ(
      summary.text(),
      "14 scans, 2 loops accepted, 1 more look alike, among too few distinct entries, 1 more "
      "look alike, but not enough to be registered, 1 more look alike, where the drive looks "
      "alike for long, 1 more look alike, but their points "
      "do not fit, 1 more look alike, but points of one float in free space of the other, 1 "
      "more look alike, but something near hides the scene, 1 more look alike, but not by the "
      "drive's motion, 1 more look alike, but other loops contradict them, 1 more look alike, but "
      "their "
      "entries have no readable points, 1 loop contradicted by later ones, 1 scan skipped");
}

}  // namespace
}  // namespace revisit::cli
