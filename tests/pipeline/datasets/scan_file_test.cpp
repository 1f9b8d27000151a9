#include "revisit/datasets/scan_file.h"

#include "testing.h"

namespace revisit {
namespace {

template <class... Values>
std::string bytes_of(const Values&... values) {
  std::string bytes;
  (bytes.append(reinterpret_cast<const char*>(&values), sizeof values), ...);
  return bytes;
}

/// Returns "" for a valid file.
std::string scan_complaint(const std::string& name, const std::string& content) {
  const TempDir dir;
  write_file(dir / name, content);
  try {
    read_scan(dir / name);
  } catch (const InputError& error) {
    EXPECT_TRUE(std::string(error.what()).starts_with((dir / name).string())) << error.what();
    return std::string(error.what()).substr((dir / name).string().size());
  }
  return "";
}

PointCloud read(const std::string& name, const std::string& content) {
  const TempDir dir;
  write_file(dir / name, content);
  return read_scan(dir / name);
}

void expect_points(const PointCloud& cloud, const std::vector<Point>& expected) {
  ASSERT_EQ(cloud.points.size(), expected.size());
  for (size_t i = 0; i < expected.size(); ++i) {
    EXPECT_EQ(cloud.points[i].x, expected[i].x) << "point " << i;
    EXPECT_EQ(cloud.points[i].y, expected[i].y) << "point " << i;
    EXPECT_EQ(cloud.points[i].z, expected[i].z) << "point " << i;
    EXPECT_EQ(cloud.points[i].intensity, expected[i].intensity) << "point " << i;
  }
}

const std::string kPcdAscii =
    "# .PCD v0.7\nVERSION 0.7\nFIELDS x y z intensity\nSIZE 4 4 4 4\nTYPE F F F F\n"
    "COUNT 1 1 1 1\nWIDTH 2\nHEIGHT 1\nVIEWPOINT 0 0 0 1 0 0 0\nPOINTS 2\nDATA ascii\n"
    "1 -2 3.5 0.25\nnan 5 6e0 7\n";

const std::string kPcdBinaryHeader =
    "VERSION .7\nFIELDS stamp z intensity x y _\nSIZE 8 8 2 4 4 1\nTYPE F F U F F U\n"
    "COUNT 1 1 1 1 1 3\nWIDTH 2\nHEIGHT 1\nPOINTS 2\n";
std::string pcd_row(double z, uint16_t intensity, float x, float y) {
  return bytes_of(1e9, z, intensity, x, y) + "???";
}
const std::string kPcdBinary =
    kPcdBinaryHeader + "DATA binary\n" + pcd_row(3, 500, 1, 2) + pcd_row(-6.5, 65535, 4, 5);

std::string replaced(std::string text, const std::string& from, const std::string& to) {
  const size_t at = text.find(from);
  EXPECT_NE(at, std::string::npos) << from;
  return text.replace(at, from.size(), to);
}

/// Values after x, y, z: intensity, channel, time.
std::vector<double> street(size_t numbers, size_t points) {
  std::mt19937 random(3);
  std::normal_distribution<double> gaussian;
  std::vector<double> values;
  for (size_t i = 0; i < points; ++i) {
    const double row[] = {20 * gaussian(random),
                          6 * gaussian(random),
                          -1.7 + 0.3 * gaussian(random),
                          static_cast<double>(random() % 100) / 100,
                          static_cast<double>(random() % 32),
                          static_cast<double>(i) * 1e-6};
    values.insert(values.end(), row, row + numbers);
  }
  return values;
}

template <class Number>
std::string as_bytes_of(const std::vector<double>& values) {
  std::string bytes;
  for (const double value : values) bytes += bytes_of(static_cast<Number>(value));
  return bytes;
}

/// Pairs of these float32 look like float64 coordinates.
TEST(ScanFile, NarrowRoomsAreNotTakenForOtherLayouts) {
  const TempDir dir;
  std::mt19937 random(4);
  for (const float half_width : {1.2F, 2.0F, 3.0F, 5.0F})
    for (const int intensity : {0, 1, 2})
      for (const size_t points : {7200, 14400, 14403}) {
        PointCloud room;
        for (size_t i = 0; i < points; ++i) {
          const float azimuth = static_cast<float>(random() % 6283) / 1000;
          const float elevation = static_cast<float>(static_cast<int>(random() % 16) * 2 - 15) / 57;
          const float range = std::min(half_width / std::abs(std::sin(azimuth)), 30.0F);
          room.points.push_back({range * std::cos(azimuth), range * std::sin(azimuth),
                                 range * std::tan(elevation),
                                 intensity == 0   ? 1
                                 : intensity == 1 ? 0
                                                  : static_cast<float>(random() % 100) / 100});
        }
        write_kitti_scan(dir / "a.bin", room);
        const PointCloud back = read_scan(dir / "a.bin");
        ASSERT_EQ(back.points.size(), points) << half_width << " m, intensity " << intensity;
        ASSERT_EQ(back.points[99].y, room.points[99].y);
      }
}

TEST(ScanFile, BinFilesOfOtherLayoutsAreTold) {
  const TempDir dir;
  for (const size_t numbers : {3, 4, 5, 6})
    for (const bool doubles : {false, true})
      for (const size_t points : {240, 4801, 32768, 33000, 57600, 60001}) {
        const std::vector<double> values = street(numbers, points);
        const fs::path file = dir / "a.bin";
        write_file(file, doubles ? as_bytes_of<double>(values) : as_bytes_of<float>(values));
        const PointCloud cloud = read_scan(file);
        ASSERT_EQ(cloud.points.size(), points) << numbers << doubles;
        for (size_t i = 0; i < points; ++i) {
          const auto at = [&](size_t c) { return static_cast<float>(values[i * numbers + c]); };
          const Point& p = cloud.points[i];
          ASSERT_EQ(p.x, at(0));
          ASSERT_EQ(p.y, at(1));
          ASSERT_EQ(p.z, at(2));
          ASSERT_EQ(p.intensity, numbers > 3 ? at(3) : 0);
        }
      }
}

TEST(KittiScan, RoundTripKeepsEveryBit) {
  const TempDir dir;
  const float nan = std::numeric_limits<float>::quiet_NaN();
  const PointCloud cloud{{{1, -2, 3, 0.5F}, {nan, nan, nan, 0}, {0, 0, 0, 0}, {1e-40F, 0, 0, 1}}};
  write_kitti_scan(dir / "a.bin", cloud);
  EXPECT_EQ(fs::file_size(dir / "a.bin"), 64U);
  const PointCloud back = read_scan(dir / "a.bin");
  ASSERT_EQ(back.points.size(), 4U);
  EXPECT_EQ(std::memcmp(back.points.data(), cloud.points.data(), 64), 0);
  EXPECT_THROW(write_kitti_scan(dir / "no" / "a.bin", cloud), Error);
}

TEST(KittiScan, RejectsOtherFiles) {
  const std::string point = bytes_of(1.0F, 2.0F, 3.0F, 4.0F);
  const std::string truncated = scan_complaint("a.bin", point + point.substr(0, 5));
  EXPECT_HAS(truncated, "21 bytes");
  EXPECT_HAS(truncated, "remainder 5");
  EXPECT_HAS(scan_complaint("a.bin", ""), "empty");
  const float nan = std::numeric_limits<float>::quiet_NaN();
  EXPECT_HAS(scan_complaint("a.bin", bytes_of(nan, 1.0F, 2.0F, 3.0F)),
             "none of its 1 points is usable");
  EXPECT_HAS(scan_complaint("a.bin", bytes_of(0.0F, -0.0F, 0.0F, 3.0F)), "usable");
  EXPECT_HAS(scan_complaint("a.xyz", point), "unknown kind of scan '.xyz'");
  expect_error<InputError>([] { read_scan("/none/scan"); }, {"/none/scan: cannot open"});
}

TEST(KittiScan, RefusesBytesThatAreNoPoints) {
  std::string gzip = "\x1f\x8b\x08", text;
  std::mt19937 random(2);
  while (gzip.size() < 16000) gzip += static_cast<char>(random() % 256);
  while (text.size() < 1600) text += "1.25 -3.5 0.25 0.125\n";
  text.resize(1600);
  EXPECT_HAS(scan_complaint("a.bin", gzip), "not a scan of float32 x y z");
  EXPECT_HAS(scan_complaint("a.bin", gzip), "gzip file, unpack it");
  EXPECT_HAS(scan_complaint("a.bin", text), "not a scan of float32 x y z");
  EXPECT_EQ(scan_complaint("a.bin", text).find("gzip"), std::string::npos);
  // A map's coordinates; a scan whose first point starts as a gzip file does.
  EXPECT_HAS(scan_complaint("a.bin", bytes_of(4.5e5F, 5.4e6F, 120.0F, 1.0F)),
             "in the sensor's frame");
  EXPECT_EQ(scan_complaint("a.bin",
                           std::string("\x1f\x8b", 2) + bytes_of(3.0F, 2.0F, 3.0F, 4.0F).substr(2)),
            "");
}

TEST(KittiScan, NamesTheFileThatIsNotThere) {
  const TempDir dir;
  for (const char* const name : {"a.bin", "a.pcd", "a.ply"})
    EXPECT_THROW(read_scan(dir / name), InputError) << name;
  fs::create_directories(dir / "folder.bin");
  EXPECT_THROW(read_scan(dir / "folder.bin"), InputError);
  EXPECT_TRUE(is_scan_file_name("A.PCD"));
  EXPECT_FALSE(is_scan_file_name("a.bin.part"));
}

TEST(Pcd, Ascii) {
  const PointCloud cloud = read("a.pcd", kPcdAscii);
  ASSERT_EQ(cloud.points.size(), 2U);
  EXPECT_EQ(cloud.points[0].z, 3.5F);
  EXPECT_EQ(cloud.points[0].intensity, 0.25F);
  EXPECT_TRUE(std::isnan(cloud.points[1].x));
  EXPECT_EQ(cloud.points[1].z, 6);
}

TEST(Pcd, BinaryWithAnyFieldOrderAndType) {
  expect_points(read("a.PCD", kPcdBinary), {{1, 2, 3, 500}, {4, 5, -6.5F, 65535}});
  const std::string no_intensity = replaced(kPcdBinary, "intensity", "ring_____");
  expect_points(read("a.pcd", no_intensity), {{1, 2, 3, 0}, {4, 5, -6.5F, 0}});
}

/// LZF, field after field: literal runs, and a copy for the four equal bytes of each intensity.
TEST(Pcd, BinaryCompressed) {
  const std::string header = replaced(replaced(kPcdAscii, "DATA ascii", "DATA binary_compressed"),
                                      "1 -2 3.5 0.25\nnan 5 6e0 7\n", "");
  const std::string xyz = bytes_of(1.0F, 4.0F, 2.0F, 5.0F, 3.0F, 6.0F);         // 24 bytes
  const std::string intensities = bytes_of(0.0F) + "\x40" + std::string(1, 3);  // 3 + 2 again
  const std::string lzf = "\x17" + xyz + "\x03" + intensities.substr(0, 4) + intensities.substr(4);
  const auto compressed = static_cast<uint32_t>(lzf.size());
  const std::string file = header + bytes_of(compressed, uint32_t{32}) + lzf;
  expect_points(read("a.pcd", file), {{1, 2, 3, 0}, {4, 5, 6, 0}});

  EXPECT_HAS(scan_complaint("a.pcd", file.substr(0, file.size() - 1)), "truncated");
  EXPECT_HAS(scan_complaint("a.pcd", header + "abc"), "truncated");
  EXPECT_HAS(scan_complaint("a.pcd", header + bytes_of(compressed, uint32_t{33}) + lzf), "33");
  EXPECT_HAS(scan_complaint("a.pcd", header + bytes_of(uint32_t{0}, uint32_t{32})), "corrupt");
  for (size_t i = 0; i < lzf.size(); ++i) {  // any corrupt byte is rejected or read, never a crash
    std::string damaged = file;
    damaged[header.size() + 8 + i] = static_cast<char>(0xFF);
    scan_complaint("a.pcd", damaged);
  }
}

TEST(Pcd, ACompressedLieCostsNoMemory) {
  std::string header = replaced(kPcdAscii, "DATA ascii", "DATA binary_compressed");
  header = replaced(replaced(header, "WIDTH 2", "WIDTH 268435455"), "POINTS 2", "POINTS 268435455");
  header.resize(header.find("compressed\n") + 11);
  EXPECT_HAS(scan_complaint("a.pcd", header + bytes_of(uint32_t{1}, uint32_t{4294967280}) + "x"),
             "corrupt");
}

TEST(Pcd, RefusesMalformedHeaders) {
  struct Case {
    std::string from, to, says;
  };
  const std::vector<Case> cases = {
      {"POINTS 2", "POINTS 3", "WIDTH 2 x HEIGHT 1 is not POINTS 3"},
      {"POINTS 2", "POINTS -2", ":8: expected a count"},
      {"WIDTH 2", "WIDTH 99999999999999999999", ":6: expected a count"},
      {"WIDTH 2\nHEIGHT 1\nPOINTS 2", "WIDTH 4000000000\nHEIGHT 4000000000", "truncated"},
      {"WIDTH 2\nHEIGHT 1\nPOINTS 2\n", "", "neither POINTS nor WIDTH"},
      {"SIZE 8 8 2 4 4 1", "SIZE 8 8 2 4 -4 1", "unknown type"},
      {"SIZE 8 8 2 4 4 1", "SIZE 8 8 2 4 3 1", "unknown type: TYPE F of SIZE 3"},
      {"SIZE 8 8 2 4 4 1", "SIZE 8 8 2 4 4", "5 SIZE"},
      {"TYPE F F U F F U", "TYPE F F U F F Q", "TYPE Q"},
      {"COUNT 1 1 1 1 1 3", "COUNT 1 1 1 1 1 4000000000", "truncated"},
      {"COUNT 1 1 1 1 1 3", "COUNT 1 1 1 1 0 3", "no such 'y'"},
      {"x y _", "x w _", "no such 'y'"},
      {"FIELDS", "FEILDS", ":2: not a line of a PCD header: 'FEILDS'"},
      {"DATA binary", "DATA morse", ":9: expected DATA ascii"},
      {"DATA binary\n", "", "not a line of a PCD header"},
  };
  for (const Case& c : cases)
    EXPECT_HAS(scan_complaint("a.pcd", replaced(kPcdBinary, c.from, c.to)), c.says);
  EXPECT_HAS(scan_complaint("a.pcd", ""), "has no line DATA");
  EXPECT_HAS(scan_complaint("a.pcd", kPcdBinary.substr(0, kPcdBinary.size() - 1)),
             ":9: truncated: 2 points of 29 bytes do not fit the 57 bytes");
}

TEST(Pcd, RefusesMalformedText) {
  EXPECT_HAS(scan_complaint("a.pcd", replaced(kPcdAscii, "-2", "abc")),
             ":12: expected a number, found 'abc'");
  EXPECT_HAS(scan_complaint("a.pcd", replaced(kPcdAscii, "-2", "-2x")),
             ":12: expected a number, found '-2x'");
  EXPECT_HAS(scan_complaint("a.pcd", replaced(kPcdAscii, " 0.25", "")),
             ":12: expected 4 values, found 3");
  EXPECT_HAS(scan_complaint("a.pcd", kPcdAscii + "1 2 3 4\n"), ":14: more lines than the 2 points");
  EXPECT_HAS(scan_complaint("a.pcd", replaced(kPcdAscii, "nan 5 6e0 7\n", "")),
             "expected 2 points, found 1");
}

const std::string kPlyHeader =
    "ply\nformat ascii 1.0\ncomment a test\nelement camera 1\nproperty int id\n"
    "element vertex 2\nproperty float x\nproperty double y\nproperty short z\n"
    "property uchar intensity\nelement face 1\nproperty list uchar int "
    "vertex_indices\nend_header\n";
const std::string kPlyAscii = kPlyHeader + "77\n1 2.5 -3 200\n4 5 6 7\n3 0 1 0\n";

TEST(Ply, Ascii) {
  expect_points(read("a.ply", kPlyAscii), {{1, 2.5F, -3, 200}, {4, 5, 6, 7}});
  std::string crlf;
  for (const char c : kPlyAscii) crlf += c == '\n' ? std::string("\r\n") : std::string(1, c);
  expect_points(read("a.ply", crlf), {{1, 2.5F, -3, 200}, {4, 5, 6, 7}});
}

std::string reversed_each(std::vector<std::string> values, bool reverse) {
  std::string all;
  for (std::string& value : values) {
    if (reverse) std::reverse(value.begin(), value.end());
    all += value;
  }
  return all;
}

TEST(Ply, BinaryOfBothByteOrders) {
  for (const bool big : {false, true}) {
    const std::string header =
        replaced(kPlyHeader, "ascii", big ? "binary_big_endian" : "binary_little_endian");
    const std::string body =
        reversed_each({bytes_of(int32_t{77}), bytes_of(1.0F), bytes_of(2.5), bytes_of(int16_t{-3}),
                       "\xC8", bytes_of(4.0F), bytes_of(5.0), bytes_of(int16_t{6}), "\x07"},
                      big);
    expect_points(read("a.ply", header + body + "face"), {{1, 2.5F, -3, 200}, {4, 5, 6, 7}});
    EXPECT_HAS(scan_complaint("a.ply", header + body.substr(0, body.size() - 1)), "truncated");
    EXPECT_HAS(scan_complaint("a.ply", header + "abc"), "'camera'");
  }
}

TEST(Ply, RefusesMalformedFiles) {
  struct Case {
    std::string from, to, says;
  };
  const std::vector<Case> cases = {
      {"ply\n", "plx\n", ":1: expected 'ply'"},
      {"ascii", "ASCII", "found 'ASCII'"},
      {"vertex 2", "vertex -2", ":6: expected a count"},
      {"vertex 2", "vertex 4294967295", "expected 4294967295 points, found"},
      {"vertex 2", "vertex 99999999999", ":6: expected a count"},
      {"vertex 2", "vertices 2", "no element 'vertex'"},
      {"camera 1", "camera 4294967295", "truncated before"},
      {"property short z\n", "", "no such 'z'"},
      {"short z", "shirt z", ":9: unknown property type: 'shirt'"},
      {"short z", "list uchar float z", "list properties"},
      {"end_header\n", "", ":13: not a line of a PLY header"},
      {"2.5", "two", ":15: expected a number, found 'two'"},
      {"2.5", "", ":15: expected 4 values, found 3"},
  };
  for (const Case& c : cases)
    EXPECT_HAS(scan_complaint("a.ply", replaced(kPlyAscii, c.from, c.to)), c.says);
  EXPECT_HAS(scan_complaint("a.ply", ""), ":1: expected 'ply'");
  const std::string list_first = replaced(replaced(kPlyHeader, "ascii", "binary_little_endian"),
                                          "property int id", "property list uchar int ids");
  EXPECT_HAS(scan_complaint("a.ply", list_first + "xxxxxxxx"), "holds lists and precedes");
}

// Figures of PCL 1.13's own reader.

struct Sums {
  size_t points = 0, nan = 0, origin = 0;
  double x = 0, y = 0, z = 0, intensity = 0;
};

Sums sums_of(const PointCloud& cloud) {
  Sums sums;
  sums.points = cloud.points.size();
  for (const Point& p : cloud.points) {
    if (!is_return(p)) ++(std::isnan(p.x) ? sums.nan : sums.origin);
    if (std::isnan(p.x)) continue;
    sums.x += double{p.x};
    sums.y += double{p.y};
    sums.z += double{p.z};
    sums.intensity += double{p.intensity};
  }
  return sums;
}

TEST(RealScans, PcdFilesReadAsPclReadsThem) {
  REVISIT_NEED_SHARED(folder, "data/other_lidars");
  const Sums compressed = sums_of(read_scan(folder / "hdl64_binary_compressed.pcd"));
  EXPECT_EQ(compressed.points, 106825U);
  EXPECT_NEAR(compressed.x, 153160.441347, 1e-5);
  EXPECT_NEAR(compressed.y, -3826.52328131, 1e-5);
  EXPECT_NEAR(compressed.z, -160896.020838, 1e-5);
  EXPECT_EQ(compressed.intensity, 14373066);
  const Sums with_origin = sums_of(read_scan(folder / "hdl32_with_origin_points.pcd"));
  EXPECT_EQ(with_origin.points, 69088U);
  EXPECT_EQ(with_origin.origin, 69088U - 64056U);
  EXPECT_NEAR(with_origin.x, 22321.2453644, 1e-5);
  EXPECT_EQ(with_origin.intensity, 2043859);
  const Sums with_nan = sums_of(read_scan(folder / "vlp16_like_with_nan.pcd"));
  EXPECT_EQ(with_nan.points, 32000U);
  EXPECT_EQ(with_nan.nan, 6793U);
  EXPECT_NEAR(with_nan.y, 31692.9814992, 1e-5);
}

TEST(RealScans, KittiFileReadsWhole) {
  REVISIT_NEED_SHARED(file, "data/kitti/sequences/00/velodyne/000052.bin");
  const PointCloud cloud = read_scan(file);
  EXPECT_EQ(cloud.points.size(), fs::file_size(file) / 16);
  const TempDir dir;
  write_kitti_scan(dir / "copy.bin", cloud);
  EXPECT_EQ(read_file(dir / "copy.bin"), read_file(file));
}

}  // namespace
}  // namespace revisit
