// OpenCV 4.14's imread() and resize() wrote fixtures/pictures.
#include "pictures/picture.h"

#include "testing.h"

namespace revisit {
namespace {

using cli::picture_input;

fs::path picture_file(const std::string& name) {
  return test::fixture("pictures/" + name);
}

TEST(Picture, IsReadAsOpenCvReadsIt) {
  for (const char* name : {"color.jpg", "gray.jpg", "alpha16.png", "palette.png"}) {
    SCOPED_TRACE(name);
    for (const auto& [channels, suffix] : {std::pair{3, ".bgr"}, {1, ".gray"}}) {
      const cli::Picture picture = cli::read_picture(picture_file(name), channels);
      EXPECT_EQ(picture.width, 17);
      EXPECT_EQ(picture.height, 11);
      const std::string wanted = read_file(picture_file(str(name, suffix)));
      EXPECT_EQ(std::string(picture.pixels.begin(), picture.pixels.end()), wanted) << suffix;
    }
  }
}

TEST(Picture, IsStretchedAsOpenCvStretchesIt) {
  for (const auto& [h, w] : {std::pair{7, 9}, {23, 20}}) {
    const auto wanted = proto::read_npy(picture_file(str("color_", h, "x", w, ".npy")));
    const auto found = picture_input({picture_file("color.jpg")}, "data", {5, 3, h, w}, false);
    EXPECT_EQ(found.shape, wanted.shape);
    ASSERT_EQ(found.data.size(), wanted.data.size());
    for (size_t i = 0; i < wanted.data.size(); ++i)
      ASSERT_NEAR(found.data[i], wanted.data[i], 1e-3) << h << "x" << w << " at " << i;
  }
}

TEST(Picture, BecomesGrayOrRgbWhereTheNetTakesThat) {
  const auto gray = picture_input({picture_file("color.jpg")}, "data", {1, 1, 11, 17}, false);
  const std::string wanted = read_file(picture_file("color.jpg.gray"));
  const auto* const levels = reinterpret_cast<const uint8_t*>(wanted.data());
  EXPECT_EQ(gray.data, std::vector<float>(levels, levels + wanted.size()));

  const fs::path both[] = {picture_file("color.jpg"), picture_file("gray.jpg")};
  const engine::Shape input{1, 3, 11, 17};
  const auto bgr = picture_input({both[0], both[1]}, "data", input, false);
  const auto rgb = picture_input({both[0], both[1]}, "data", input, true);
  EXPECT_EQ(rgb.shape, (std::vector<int64_t>{2, 3, 11, 17}));
  constexpr size_t kPlane = 11 * 17;
  for (size_t i = 0; i < kPlane; ++i) {
    ASSERT_EQ(bgr.data[i], rgb.data[2 * kPlane + i]);
    ASSERT_EQ(bgr.data[3 * kPlane + i], bgr.data[5 * kPlane + i]) << "a gray picture";
  }
}

TEST(Picture, SaysThatItIsTurned) {
  const std::string tiffs[] = {{"MM\0\x2a\0\0\0\x08\0\x02"
                                "\1\0\0\3\0\0\0\1\0\x09\0\0"
                                "\1\x12\0\3\0\0\0\1\0\6\0\0",
                                34},
                               {"II\x2a\0\x08\0\0\0\1\0\x12\1\3\0\1\0\0\0\6\0\0\0", 22}};
  const TempDir dir;
  const std::string jpeg = read_file(picture_file("color.jpg"));
  std::mt19937 random(1);
  for (const std::string& tiff : tiffs) {
    const std::string exif = std::string("Exif\0\0", 6) + tiff;
    EXPECT_EQ(cli::exif_orientation(exif), 6);
    for (size_t size = 0; size < exif.size(); ++size) {
      const std::vector<char> cut(exif.begin(), exif.begin() + static_cast<ptrdiff_t>(size));
      const int found = cli::exif_orientation({cut.data(), size});
      EXPECT_TRUE(found == 1 || (found == 6 && size + 3 >= exif.size())) << size << ": " << found;
    }
    for (int i = 0; i < 20000; ++i) {
      std::string damaged = exif;
      for (int n = 0; n < 4; ++n) damaged[random() % exif.size()] = static_cast<char>(random());
      const std::vector<char> alone(damaged.begin(), damaged.end());  // exact size for sanitizers
      const int found = cli::exif_orientation({alone.data(), alone.size()});
      EXPECT_TRUE(found >= 1 && found <= 8);
    }
    std::string turned = jpeg;
    turned.insert(2, str("\xff\xe1", '\0', static_cast<char>(exif.size() + 2), exif));
    write_file(dir / "turned.jpg", turned);
    testing::internal::CaptureStderr();
    const cli::Picture picture = cli::read_picture(dir / "turned.jpg", 3);
    const std::string said = testing::internal::GetCapturedStderr();
    EXPECT_HAS(said,
               "turned.jpg: EXIF says that the picture is rotated or mirrored (orientation 6)");
    EXPECT_EQ(picture.pixels, cli::read_picture(picture_file("color.jpg"), 3).pixels);
  }
}

TEST(Picture, NamesTheFaultsOfFiles) {
  const TempDir dir;
  const auto said = [&](const std::string& content) {
    write_file(dir / "p", content);
    return message_of<Error>([&] { cli::read_picture(dir / "p", 3); });
  };
  const std::string p = (dir / "p").string();
  EXPECT_EQ(said("GIF89a"), p + ": not a picture: expected PNG or JPEG");
  EXPECT_EQ(said(std::string("\x89PNG\r\n\x1a\n")), p + ": not a PNG picture: it ends too early");
  const std::string png = read_file(picture_file("alpha16.png"));
  EXPECT_EQ(said(png.substr(0, png.size() / 2)),
            p + ": the PNG picture is corrupt: it ends too early");
  EXPECT_TRUE(said("\xff\xd8\xff").starts_with(p + ": not a JPEG picture: "));
  std::string large = read_file(picture_file("color.jpg"));
  large.replace(large.find("\xff\xc0") + 5, 4, "pppp");  // its height and width
  EXPECT_EQ(said(large), p + ": 28784 x 28784 pixels; pictures of up to 67108864 pixels are read");
  EXPECT_HAS(message_of<Error>([&] { cli::read_picture(dir / "none.png", 3); }),
             "none.png: cannot open");
  for (const engine::Shape& shape : {engine::Shape{1, 4, 5, 5}, engine::Shape{1, 75}})
    EXPECT_HAS(message_of<Error>(
                   [&] { picture_input({picture_file("color.jpg")}, "data", shape, false); }),
               "the input 'data' is " + shape.text());
}

}  // namespace
}  // namespace revisit
