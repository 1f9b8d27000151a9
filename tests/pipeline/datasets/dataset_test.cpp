#include "revisit/datasets/dataset.h"

#include <sys/inotify.h>
#include <unistd.h>

#include "folder.h"
#include "revisit/datasets/scan_file.h"
#include "testing.h"

namespace revisit {
namespace {

std::string poses(int count) {
  std::string text;
  for (int i = 0; i < count; ++i) text += "1 0 0 " + std::to_string(i) + " 0 1 0 0 0 0 1 0\n";
  return text;
}
std::string times(int count) {
  std::string text;
  for (int i = 0; i < count; ++i) text += std::to_string(i * 10) + "\n";
  return text;
}

/// Frames 2 and 10.
void write_sequence(const fs::path& root, const std::string& sequence) {
  for (const char* const name : {"000010.bin", "000002.bin"})
    write_file(root / "sequences" / sequence / "velodyne" / name, "0123456789abcdef");
}

std::vector<int> frames(const Dataset& dataset) {
  std::vector<int> result;
  for (const ScanRef& scan : dataset.scans) result.push_back(scan.frame);
  return result;
}

TEST(KittiDataset, RootWithEverything) {
  const TempDir dir;
  const fs::path root = dir / "kitti";
  write_sequence(root, "00");
  write_file(root / "poses/00.txt", poses(11));
  write_file(root / "sequences/00/times.txt", times(11));
  write_file(root / "sequences/00/calib.txt", "P0: of the gray images's archive, without Tr\n");
  write_file(root / "sequences/00/velodyne/.hidden.bin", "");
  write_file(root / "sequences/00/velodyne/notes.txt", "");

  for (const char* const sequence : {"00", ""}) {
    const Dataset dataset = open_dataset(root, sequence, true);
    EXPECT_EQ(dataset.name, "kitti");
    EXPECT_EQ(dataset.sequence, "00");
    EXPECT_EQ(frames(dataset), (std::vector<int>{2, 10}));
    EXPECT_EQ(dataset.scans[1].file, root / "sequences/00/velodyne/000010.bin");
    EXPECT_TRUE(dataset.has_poses());
    EXPECT_EQ(dataset.scans[1].pose->translation().x(), 10);
    EXPECT_EQ(dataset.scans[1].time, 100);
  }
}

TEST(KittiDataset, OnlyTheNamedSequenceIsLookedAt) {
  const TempDir dir;
  for (const char* const sequence : {"00", "01"}) write_sequence(dir.path(), sequence);
  const int events = ::inotify_init1(IN_NONBLOCK);
  ASSERT_GE(events, 0);
  const fs::path other = dir / "sequences/01/velodyne";
  ASSERT_GE(::inotify_add_watch(events, other.c_str(), IN_OPEN | IN_ACCESS), 0);
  char event[4096];
  EXPECT_EQ(open_dataset(dir.path(), "00").scans.size(), 2u);
  EXPECT_LT(::read(events, event, sizeof event), 0) << "the folder of another was opened";
  EXPECT_THROW(open_dataset(dir.path(), ""), InputError);  // ambiguous
  EXPECT_GT(::read(events, event, sizeof event), 0) << "the test sees nothing";
  ::close(events);
  EXPECT_THROW(open_dataset(dir / "sequences", "../sequences/00"), InputError);
  EXPECT_THROW(open_dataset(dir.path(), "../sequences/00"), InputError);
}

TEST(KittiDataset, TheFirstScanIsEnoughToKnowThatThereAreSome) {
  const TempDir dir;
  for (int i = 0; i < 50; ++i) write_file(dir / (std::to_string(i) + ".bin"), "");
  static int looked_at;
  looked_at = 0;
  EXPECT_TRUE(holds(dir.path(), [](const fs::path&) { return ++looked_at > 2; }));
  EXPECT_EQ(looked_at, 3);
  EXPECT_FALSE(holds(dir / "none", [](const fs::path&) { return true; }));
}

TEST(KittiDataset, OneSequenceFolder) {
  const TempDir dir;
  write_sequence(dir / "kitti", "07");
  const fs::path folder = dir / "kitti/sequences/07";
  EXPECT_FALSE(open_dataset(folder, "").has_poses());

  write_file(dir / "kitti/poses/07.txt", poses(11));  // ../../poses/NN.txt
  const Dataset dataset = open_dataset(folder, "07", true);
  EXPECT_EQ(dataset.name, "kitti");
  EXPECT_EQ(dataset.sequence, "07");
  EXPECT_TRUE(dataset.has_poses());
  EXPECT_HAS(message_of<InputError>([&] { open_dataset(folder, "08"); }),
             "there is no sequence 08");

  write_file(folder / "poses.txt", poses(20));  // the nearer file has precedence
  EXPECT_EQ(open_dataset(folder, "").n_poses, 20);
}

TEST(KittiDataset, LoneFolderWithPoses) {
  const TempDir dir;
  write_file(dir / "town/velodyne/000000.bin", "0123456789abcdef");
  write_file(dir / "town/poses.txt", poses(1));
  const Dataset dataset = open_dataset(dir / "town", "", true);
  EXPECT_EQ(dataset.name, "town");
  EXPECT_EQ(dataset.sequence, "");
  EXPECT_TRUE(dataset.has_poses());
}

TEST(KittiDataset, NamesMissingFiles) {
  const TempDir dir;
  const fs::path root = dir / "kitti";
  write_sequence(root, "00");
  const std::string no_poses = message_of<InputError>([&] { open_dataset(root, "00", true); });
  EXPECT_HAS(no_poses, (root / "poses/00.txt").string());
  EXPECT_HAS(no_poses, (root / "sequences/00/poses.txt").string());

  write_sequence(root, "05");
  EXPECT_HAS(message_of<InputError>([&] { open_dataset(root, ""); }),
             "several sequences, select one; sequences with scans: 00, 05");
  EXPECT_HAS(message_of<InputError>([&] { open_dataset(root, "0"); }), "did you mean '00'");
  EXPECT_HAS(message_of<InputError>([&] { open_dataset(dir / "none", "00"); }), "No such file");
  fs::create_directories(dir / "empty");
  EXPECT_HAS(message_of<InputError>([&] { open_dataset(dir / "empty", ""); }),
             "no scans here: looked for");
  write_file(dir / "file", "");
  EXPECT_HAS(message_of<InputError>([&] { open_dataset(dir / "file", ""); }), "not a folder");
}

TEST(KittiDataset, CompressedScansAreSaid) {
  const TempDir dir;
  const fs::path velodyne = dir / "kitti/sequences/00/velodyne";
  for (const char* name : {"000000.bin.gz", "000001.bin.gz", "notes.txt.gz"})
    write_file(velodyne / name, "");
  const std::string any = message_of<InputError>([&] { open_dataset(dir / "kitti", ""); });
  EXPECT_HAS(any, "no sequence has scans: looked for");
  EXPECT_HAS(any, "folders in sequences/: 00");
  const std::string named = message_of<InputError>([&] { open_dataset(dir / "kitti", "00"); });
  const std::string folder = message_of<InputError>([&] { open_dataset(velodyne, ""); });
  for (const std::string& said : {any, named, folder, message_of<InputError>([&] {
                                    open_dataset(dir / "kitti/sequences/00", "");
                                  })})
    EXPECT_HAS(said, velodyne.string() + " has 2 compressed ones (000000.bin.gz): unpack them");
}

TEST(KittiDataset, ListsMustReachTheLastFrame) {
  const TempDir dir;
  write_sequence(dir.path(), "00");
  write_file(dir / "poses/00.txt", poses(10));
  const std::string short_poses = message_of<InputError>([&] { open_dataset(dir.path(), "00"); });
  EXPECT_HAS(short_poses, "holds 10 poses");
  EXPECT_HAS(short_poses, "is frame 10");
  write_file(dir / "poses/00.txt", poses(11));
  write_file(dir / "sequences/00/times.txt", times(3));
  // Times are optional: invalid ones are ignored.
  const Dataset untimed = open_dataset(dir.path(), "00");
  EXPECT_FALSE(untimed.scans[0].time.has_value());
  ASSERT_EQ(untimed.warnings.size(), 1u);
  EXPECT_HAS(untimed.warnings[0], "holds 3 times");
  EXPECT_HAS(untimed.warnings[0], "no times are used");
  // A missing line shifts all later poses.
  write_file(dir / "sequences/00/times.txt", times(12));
  const Dataset shifted = open_dataset(dir.path(), "00");
  ASSERT_EQ(shifted.warnings.size(), 1u);
  EXPECT_HAS(shifted.warnings[0], "holds 11 poses");
  write_file(dir / "sequences/00/times.txt", times(11));
  EXPECT_TRUE(open_dataset(dir.path(), "00").warnings.empty());
}

TEST(KittiDataset, FrameNumbersAreUniqueNumbers) {
  const TempDir dir;
  write_sequence(dir.path(), "00");
  const fs::path velodyne = dir / "sequences/00/velodyne";
  write_file(velodyne / "10.pcd", "");
  const std::string twice = message_of<InputError>([&] { open_dataset(dir.path(), "00"); });
  EXPECT_HAS(twice, "frame 10 appears twice");
  EXPECT_HAS(twice, "000010.bin");
  fs::remove(velodyne / "10.pcd");
  write_file(velodyne / "first.bin", "");
  EXPECT_HAS(message_of<InputError>([&] { open_dataset(dir.path(), "00"); }),
             "first.bin: expected the frame's number");
}

TEST(PlainFolder, TimesOfTheNames) {
  const TempDir dir;
  // Fractions without leading zeros sort by time, not by name.
  for (const char* const name : {"1305031102_175304000.pcd", "1305031102_75304000.pcd"})
    write_file(dir / "tum" / name, "");
  const Dataset dataset = open_dataset(dir / "tum", "");
  EXPECT_EQ(frames(dataset), (std::vector<int>{0, 1}));
  ASSERT_TRUE(dataset.scans[0].time && dataset.scans[1].time);
  EXPECT_NEAR(*dataset.scans[0].time, 1305031102.075304, 1e-6);
  EXPECT_NEAR(*dataset.scans[1].time, 1305031102.175304, 1e-6);
  write_file(dir / "tum/last.pcd", "");
  EXPECT_FALSE(open_dataset(dir / "tum", "").scans[0].time) << "not all have one";

  EXPECT_NEAR(time_in_name("d/1271124530.567.bin").value(), 1271124530.567, 1e-6);
  EXPECT_EQ(time_in_name("1403715273262143000.pcd"), 1403715273262143000.0 * 1e-9);
  EXPECT_EQ(time_in_name("1403715273262143.pcd"), 1403715273262143.0 * 1e-6);
  EXPECT_EQ(time_in_name("12.5.bin"), 12.5);
  for (const char* const other :
       {"000123.bin", "1305031102.bin", "scan_12.bin", "1_2.bin", "_.bin", "1305031102_.bin",
        "1305031102_1234567890.bin", "0000000000000001.bin", "2023010112_0001.pcd", "a.1.bin", ""})
    EXPECT_FALSE(time_in_name(other)) << other;
}

TEST(PlainFolder, NumbersOfTheNamesOrTheirOrder) {
  const TempDir dir;
  const fs::path numbered = dir / "numbered";
  for (const char* const name : {"7.pcd", "12.bin", "3.PLY"}) write_file(numbered / name, "");
  const Dataset dataset = open_dataset(numbered, "");
  EXPECT_EQ(dataset.name, "numbered");
  EXPECT_EQ(frames(dataset), (std::vector<int>{3, 7, 12}));
  EXPECT_FALSE(dataset.has_poses());
  // A scan on a disk that is absent is not left out, so that its reader reports it.
  fs::create_symlink(dir / "absent.bin", numbered / "8.bin");
  fs::create_directory(numbered / "9.bin");
  EXPECT_EQ(frames(open_dataset(numbered, "")), (std::vector<int>{3, 7, 8, 12}));

  const fs::path named = dir / "named";
  for (const char* const name : {"scan10.pcd", "scan9.pcd", "1403715273262142976.pcd"})
    write_file(named / name, "");
  const Dataset ordered = open_dataset(named, "");
  EXPECT_EQ(frames(ordered), (std::vector<int>{0, 1, 2}));
  EXPECT_EQ(ordered.scans[1].file.filename(), "scan9.pcd");
  EXPECT_EQ(ordered.scans[2].file.filename(), "scan10.pcd");

  EXPECT_HAS(message_of<InputError>([&] { open_dataset(named, "", true); }), "no poses");
  EXPECT_HAS(message_of<InputError>([&] { open_dataset(named, "00"); }), "has no sequence 00");
}

TEST(RealDataset, TwelveScansOfSequence00) {
  REVISIT_NEED_SHARED(root, "data/kitti");
  const Dataset dataset = open_dataset(root, "", true);
  EXPECT_EQ(dataset.sequence, "00");
  ASSERT_EQ(dataset.scans.size(), 12U);
  EXPECT_EQ(dataset.scans.back().frame, 4501);
  // data/README: 004501 revisits 000052, 2.96 m apart.
  const auto at = [&](int frame) {
    for (const ScanRef& scan : dataset.scans)
      if (scan.frame == frame) return scan.pose->translation();
    throw Error("no such frame");
  };
  EXPECT_NEAR((at(4501) - at(52)).norm(), 2.96, 0.005);
}

TEST(PlacesDataset, AFolderPerPlace) {
  const TempDir dir;
  const fs::path root = dir / "campus";
  for (const char* const file : {"place_10/0.bin", "place_2/b.pcd", "place_2/a.PLY", "hall/7.bin",
                                 "hall/3.bin", ".git/0.bin", "notes/readme.txt"})
    write_file(root / file, "0123456789abcdef");
  const Dataset dataset = open_dataset(root, "");
  EXPECT_EQ(dataset.name, "campus");
  EXPECT_EQ(dataset.sequence, "");
  EXPECT_TRUE(dataset.has_places());
  EXPECT_FALSE(dataset.has_poses());
  EXPECT_EQ(frames(dataset), (std::vector<int>{0, 1, 2, 3, 4})) << "counted through all places";
  const std::vector<std::pair<std::string, std::string>> expected = {{"hall", "3.bin"},
                                                                     {"hall", "7.bin"},
                                                                     {"place_2", "a.PLY"},
                                                                     {"place_2", "b.pcd"},
                                                                     {"place_10", "0.bin"}};
  ASSERT_EQ(dataset.scans.size(), expected.size());
  for (size_t i = 0; i < expected.size(); ++i) {
    EXPECT_EQ(dataset.scans[i].place, expected[i].first);
    EXPECT_EQ(dataset.scans[i].file, root / expected[i].first / expected[i].second);
  }
  EXPECT_HAS(message_of<InputError>([&] { open_dataset(root, "", true); }),
             "no poses, which are required");
  EXPECT_HAS(message_of<InputError>([&] { open_dataset(root, "", true); }), "places-3");
  EXPECT_FALSE(open_dataset(root / "hall", "").has_places()) << "one place alone is a plain folder";
  write_file(root / "0.bin", "0123456789abcdef");
  EXPECT_EQ(open_dataset(root, "").scans.size(), 1U);
}

TEST(PlacesDataset, SetsOfPlacesBesideEachOther) {
  const TempDir dir;
  const fs::path root = dir / "hkust";
  write_file(root / "rotation/place_1/0.bin", "0123456789abcdef");
  EXPECT_EQ(open_dataset(root, "").sequence, "rotation") << "the only one";
  write_file(root / "objects/place_1/0.bin", "0123456789abcdef");
  write_file(root / "objects/place_2/0.bin", "0123456789abcdef");
  const Dataset dataset = open_dataset(root, "objects");
  EXPECT_EQ(dataset.name, "hkust");
  EXPECT_EQ(dataset.sequence, "objects");
  EXPECT_EQ(dataset.scans.size(), 2U);
  EXPECT_EQ(open_dataset(root / "objects", "").scans.size(), 2U);
  EXPECT_HAS(message_of<InputError>([&] { open_dataset(root, ""); }), "objects, rotation");
  EXPECT_HAS(message_of<InputError>([&] { open_dataset(root, "rotations"); }),
             "did you mean 'rotation'");
}

}  // namespace
}  // namespace revisit
