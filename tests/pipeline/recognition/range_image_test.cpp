#include "revisit/recognition/range_image.h"

#include "naive_range_image.h"
#include "revisit/datasets/scan_file.h"
#include "revisit/recognition/align.h"
#include "testing.h"
#include "turned_cloud.h"

namespace revisit {
namespace {

struct Pixel {
  int row, column;
  float value;
  bool operator==(const Pixel&) const = default;
};
std::ostream& operator<<(std::ostream& out, const Pixel& p) {
  return out << "(" << p.row << ", " << p.column << "): " << p.value;
}

std::vector<Pixel> pixels_of(const RangeImage& image) {
  std::vector<Pixel> pixels;
  for (int row = 0; row < image.height; ++row)
    for (int column = 0; column < image.width; ++column)
      if (image.at(row, column) != 0) pixels.push_back({row, column, image.at(row, column)});
  return pixels;
}

std::vector<Pixel> pixels_of(const std::vector<Point>& points, const ImageGeometry& geometry = {}) {
  return pixels_of(project({points}, geometry));
}

/// Rotates counter-clockwise about z, in a user's float arithmetic.
PointCloud yawed(const PointCloud& cloud, double angle) {
  const auto c = static_cast<float>(std::cos(angle)), s = static_cast<float>(std::sin(angle));
  PointCloud result = cloud;
  for (Point& p : result.points) p = {c * p.x - s * p.y, s * p.x + c * p.y, p.z, p.intensity};
  return result;
}

TEST(Project, HandPlacedPoints) {
  const float ten = 255.0F * 10 / 80;
  EXPECT_EQ(pixels_of({{-10, 0, 0, 0}}), (std::vector<Pixel>{{12, 0, ten}}));  // backwards
  EXPECT_EQ(pixels_of({{-10, -0.0F, 0, 0}}), (std::vector<Pixel>{{12, 0, ten}}));
  EXPECT_EQ(pixels_of({{0, 10, 0, 0}}), (std::vector<Pixel>{{12, 1000, ten}}));  // left
  EXPECT_EQ(pixels_of({{10, 0, 0, 0}}), (std::vector<Pixel>{{12, 2000, ten}}));  // ahead
  EXPECT_EQ(pixels_of({{10, -0.0F, 0, 0}}), (std::vector<Pixel>{{12, 2000, ten}}));
  EXPECT_EQ(pixels_of({{0, -10, 0, 0}}), (std::vector<Pixel>{{12, 3000, ten}}));  // right
  // Just left of backwards is the first column, just right of it the last.
  EXPECT_EQ(pixels_of({{-10, 0.001F, 0, 0}})[0].column, 0);
  EXPECT_EQ(pixels_of({{-10, -0.001F, 0, 0}})[0].column, 3999);
}

TEST(Project, RowsFromTheTopAndDroppedOutside) {
  const auto at = [](double degrees) {
    return std::vector<Point>{{10, 0, static_cast<float>(10 * std::tan(degrees * kPi / 180)), 0}};
  };
  EXPECT_EQ(pixels_of(at(2.9))[0].row, 0);
  EXPECT_EQ(pixels_of(at(2.7))[0].row, 1);
  EXPECT_EQ(pixels_of(at(-24.9))[0].row, 111);
  EXPECT_TRUE(pixels_of(at(3.01)).empty());
  EXPECT_TRUE(pixels_of(at(-25.01)).empty());
  EXPECT_TRUE(pixels_of({{0, 0, 5, 0}}).empty());   // zenith
  EXPECT_TRUE(pixels_of({{0, 0, -5, 0}}).empty());  // nadir
}

TEST(Project, NearestReturnWinsAndFarOnesSaturate) {
  const Point near{20, 0, 0, 0}, far{40, 0, 0, 0}, beyond{500, 0, 0, 0};
  const std::vector<Pixel> expected = {{12, 2000, 255.0F / 4}};
  EXPECT_EQ(pixels_of({near, far, beyond}), expected);
  EXPECT_EQ(pixels_of({beyond, far, near}), expected);
  EXPECT_EQ(pixels_of({beyond}), (std::vector<Pixel>{{12, 2000, 255}}));
  // Ranges are distances in space, not on the ground.
  EXPECT_FLOAT_EQ(pixels_of({{8, 0, -3, 0}})[0].value, 255 * std::sqrt(73.0F) / 80);
}

TEST(Project, SkipsNoReturnsAndSurvivesExtremes) {
  constexpr float kNan = std::numeric_limits<float>::quiet_NaN();
  constexpr float kInf = std::numeric_limits<float>::infinity();
  EXPECT_TRUE(
      pixels_of({{0, 0, 0, 1}, {kNan, 1, 0, 0}, {1, kNan, 0, 0}, {1, 0, kNan, 0}, {kInf, 0, 0, 0}})
          .empty());
  EXPECT_EQ(pixels_of({{3e38F, 3e38F, 0, 0}})[0].value, 255);
  EXPECT_GT(pixels_of({{1e-30F, 0, 0, 0}}).at(0).value, 0);
}

TEST(Project, AgreesWithTheFormulaForAnySize) {
  const PointCloud cloud = random_cloud(1, 20000);
  for (const int width : {1, 2, 3, 7, 500, 999, 4000})
    for (const int height : {1, 5, 112}) {
      ImageGeometry g{.width = width, .height = height};
      const RangeImage image = project(cloud, g);
      ASSERT_EQ(image.pixels.size(), static_cast<size_t>(width) * height);
      EXPECT_EQ(count_differing(image, project_naively(cloud, g), kRounding), 0)
          << width << " x " << height;
    }
}

/// One return in about a third of the pixels, at its center +- 0.3 pixels.
PointCloud centerd_cloud(const ImageGeometry& g) {
  std::mt19937 random(5);
  std::uniform_real_distribution<double> jitter(0.2, 0.8), range(2, 79);
  const double rows_per_degree = g.height / (g.elevation_top - g.elevation_bottom);
  PointCloud cloud;
  for (int row = 0; row < g.height; ++row)
    for (int column = 0; column < g.width; ++column) {
      if (random() % 3) continue;
      const double azimuth = kPi - (column + jitter(random)) * 2 * kPi / g.width;
      const double elevation =
          (g.elevation_top - (row + jitter(random)) / rows_per_degree) * kPi / 180;
      const double r = range(random), ground = r * std::cos(elevation);
      cloud.points.push_back({static_cast<float>(ground * std::cos(azimuth)),
                              static_cast<float>(ground * std::sin(azimuth)),
                              static_cast<float>(r * std::sin(elevation)), 0});
    }
  return cloud;
}

/// Shifts the image to the left (negative: to the right), with wrap-around.
RangeImage shifted(RangeImage image, int columns) {
  const int by = (columns % image.width + image.width) % image.width;
  for (int row = 0; row < image.height; ++row) {
    const auto begin = image.pixels.begin() + std::ptrdiff_t{row} * image.width;
    std::rotate(begin, begin + by, begin + image.width);
  }
  return image;
}

TEST(Project, AYawIsExactlyAColumnShift) {
  for (const int width : {4000, 1000, 333}) {
    const ImageGeometry g{.width = width, .height = 28};
    const PointCloud cloud = centerd_cloud(g);
    const RangeImage image = project(cloud, g);
    ASSERT_EQ(pixels_of(image).size(), cloud.points.size());
    for (const int columns :
         {0, 1, 2, 3, 10, width / 4, width / 3, width / 2, width - 1, -1, -7, 5 * width + 2}) {
      const RangeImage turned = project(yawed(cloud, columns * 2 * kPi / width), g);
      // Ranges differ by the rounding of the rotation.
      EXPECT_EQ(count_differing(turned, shifted(image, columns), 2e-4F), 0)
          << width << ", " << columns;
    }
  }
}

TEST(Project, AHalfTurnIsExactlyHalfTheWidth) {
  const PointCloud cloud = random_cloud(2, 20000);
  for (const int width : {2, 100, 4000}) {
    const ImageGeometry g{.width = width};
    EXPECT_EQ(project(turned_by_half(cloud), g).pixels,
              shifted(project(cloud, g), width / 2).pixels);
  }
}

/// Width and height in pixels.
ImageGeometry closing_by(ImageGeometry g, int width, int height) {
  g.closing_width = width * 360.0 / g.width;
  g.closing_height = height * (g.elevation_top - g.elevation_bottom) / g.height;
  return g;
}

TEST(CloseHoles, AgreesWithTheDefinition) {
  struct Size {
    int width, height;
  };
  for (const Size size : {Size{1, 1}, {5, 3}, {7, 9}, {40, 12}, {64, 1}, {101, 33}})
    for (const Size rectangle :
         {Size{1, 1}, {5, 3}, {3, 5}, {1, 3}, {7, 1}, {5, 9}, {17, 31}, {101, 33}}) {
      if (rectangle.width > size.width || rectangle.height > size.height) continue;
      const RangeImage image = sparse_image(size.width, size.height);
      const ImageGeometry g = closing_by({.width = size.width, .height = size.height},
                                         rectangle.width, rectangle.height);
      const RangeImage closed = close_holes(image, g);
      EXPECT_EQ(closed.pixels, close_naively(image, rectangle.width, rectangle.height).pixels)
          << size.width << " x " << size.height << " by " << rectangle.width << " x "
          << rectangle.height;
      EXPECT_EQ(close_holes(closed, g).pixels, closed.pixels) << "closing is idempotent";
      for (size_t i = 0; i < image.pixels.size(); ++i) EXPECT_GE(closed.pixels[i], image.pixels[i]);
      EXPECT_EQ(close_holes(shifted(image, 3), g).pixels, shifted(closed, 3).pixels)
          << "wraps around";
    }
}

TEST(CloseHoles, FillsAGapAcrossTheEdge) {
  RangeImage image{8, 1, {9, 9, 0, 9, 9, 9, 9, 0}};
  const ImageGeometry g = closing_by({.width = 8, .height = 1}, 3, 1);
  EXPECT_EQ(close_holes(image, g).pixels, std::vector<float>(8, 9));
}

TEST(Geometry, TheClosingRectangleKeepsItsAngle) {
  const auto pixels = [](ImageGeometry g) {
    const auto [width, height] = closing_rectangle(g);
    return std::pair(width, height);
  };
  using Pair = std::pair<int, int>;
  EXPECT_EQ(pixels({}), Pair(5, 3)) << "of an HDL-64E, since the first version";
  // Halved, doubled, ...: the odd number nearest to 0.45 x 0.75 degrees, the larger of two.
  EXPECT_EQ(pixels({.width = 2000, .height = 56}), Pair(3, 1));
  EXPECT_EQ(pixels({.width = 8000, .height = 224}), Pair(11, 7));
  EXPECT_EQ(pixels({.width = 400, .height = 107}), Pair(1, 3));
  EXPECT_EQ(pixels({.width = 40000, .height = 1120}), Pair(51, 31));
  EXPECT_EQ(pixels({.elevation_top = 17, .elevation_bottom = -39}), Pair(5, 1));
  EXPECT_EQ(pixels({.closing_width = 0, .closing_height = 0}), Pair(1, 1));
  EXPECT_EQ(pixels({.closing_width = 360, .closing_height = 90}), Pair(3999, 111));
}

TEST(Geometry, RejectsInvalidSizes) {
  const auto refused = [](auto change) {
    ImageGeometry g;
    change(g);
    EXPECT_THROW(check_geometry(g), UsageError);
    EXPECT_THROW(project({}, g), UsageError);
    EXPECT_THROW(close_holes({}, g), UsageError);
  };
  refused([](ImageGeometry& g) { g.width = 0; });
  refused([](ImageGeometry& g) { g.height = -1; });
  refused([](ImageGeometry& g) { g.width = g.height = 60000; });
  refused([](ImageGeometry& g) { g.elevation_top = g.elevation_bottom; });
  refused([](ImageGeometry& g) { g.elevation_top = 91; });
  refused([](ImageGeometry& g) { g.elevation_bottom = std::nan(""); });
  refused([](ImageGeometry& g) { g.max_range = 0; });
  refused([](ImageGeometry& g) { g.max_range = std::numeric_limits<double>::infinity(); });
  refused([](ImageGeometry& g) { g.closing_width = -0.1; });
  refused([](ImageGeometry& g) { g.closing_width = 361; });
  refused([](ImageGeometry& g) { g.closing_width = std::nan(""); });
  refused([](ImageGeometry& g) { g.closing_height = -1; });
  EXPECT_THROW(close_holes({3, 3, std::vector<float>(9)}, ImageGeometry{}), UsageError);
}

TEST(WritePng, EightBitGrayOfTheImagesSize) {
  const TempDir dir;
  write_gray_png(dir / "a.png", gray_of({300, 2, std::vector<float>(600, 254.6F)}));
  const std::string png = read_file(dir / "a.png");
  EXPECT_EQ(png.substr(0, 8), "\x89PNG\r\n\x1a\n");
  EXPECT_EQ(png.substr(16, 10),
            std::string("\0\0\x01\x2C\0\0\0\x02\x08\0", 10));  // 300 x 2, 8 bit, gray
  EXPECT_THROW(write_gray_png(dir / "no" / "a.png", gray_of({1, 1, {0}})), Error);
  EXPECT_THROW(write_gray_png(dir / "b.png", gray_of({})), Error);
  EXPECT_FALSE(std::filesystem::exists(dir / "b.png"));
}

TEST(RealScans, HitRateOfPaperNotes) {
  REVISIT_NEED_SHARED(file, "data/kitti/sequences/00/velodyne/000052.bin");
  const RangeImage image = project(read_scan(file), sensor_geometry("hdl64"));
  EXPECT_NEAR(static_cast<double>(pixels_of(image).size()) / (4000 * 112), 0.27, 0.01);
}

TEST(RealScans, AgreeWithTheFormulaAndTurnByShifting) {
  REVISIT_NEED_SHARED(file, "data/kitti/sequences/00/velodyne/004501.bin");
  const PointCloud scan = read_scan(file);
  const ImageGeometry g = sensor_geometry("hdl64");
  const RangeImage image = project(scan, g);
  EXPECT_EQ(count_differing(image, project_naively(scan, g), kRounding), 0);
  // Float coordinates of the rotated cloud are accurate to 1e-4 columns. Of 120,000 points some ten
  // are so near to a border that they change pixels, and each changes two pixels.
  const int allowed = 4000 * 112 / 10000;
  for (const int columns : {1, 7, 500, 1777, 2000, 3999})
    EXPECT_LE(count_differing(project(yawed(scan, columns * 2 * kPi / g.width), g),
                              shifted(image, columns), 1e-3F),
              allowed)
        << columns;
}

TEST(RealScans, HalfTurnedInCaseTwoIsTheSameImageToTheBit) {
  REVISIT_NEED_SHARED(file, "data/kitti/sequences/00/velodyne/000052.bin");
  const ImageGeometry g = sensor_geometry("hdl64");
  const auto image_of = [&](const PointCloud& cloud, AlignCase which) {
    return project(rotated(cloud, principal_alignment(cloud, which).R_aligned_sensor), g);
  };
  const PointCloud scan = read_scan(file);
  const RangeImage one = image_of(scan, AlignCase::kOne);
  EXPECT_EQ(image_of(turned_by_half(scan), AlignCase::kTwo).pixels, one.pixels);
  const RangeImage two = image_of(scan, AlignCase::kTwo);
  EXPECT_EQ(two.pixels, shifted(one, g.width / 2).pixels);
  EXPECT_EQ(close_holes(two, g).pixels, shifted(close_holes(one, g), g.width / 2).pixels);
}

}  // namespace
}  // namespace revisit
