// Pictures as nets take them, beside OpenCV 4.14's imread(), cvtColor() and resize(), which wrote
// fixtures/pictures.
#include "pictures/picture.h"

#include <gtest/gtest.h>

#include "pictures/picture_input.h"
#include "test_data.h"

namespace revisit {
namespace {

namespace fs = std::filesystem;
using cli::picture_input;

fs::path picture_file(const std::string& name) {
  return test::fixture("pictures/" + name);
}

/// "" for no error.
std::string picture_error(const std::function<void()>& act) {
  try {
    act();
  } catch (const Error& error) {
    return error.what();
  }
  return "";
}

TEST(Picture, IsReadAsOpenCvReadsIt) {
  for (const char* name : {"color.jpg", "gray.jpg", "alpha16.png", "palette.png"}) {
    SCOPED_TRACE(name);
    const cli::Picture picture = cli::read_picture(picture_file(name));
    EXPECT_EQ(picture.width, 17);
    EXPECT_EQ(picture.height, 11);
    const std::string wanted = test::read_file(picture_file(std::string(name) + ".bgr"));
    EXPECT_EQ(std::string(picture.bgr.begin(), picture.bgr.end()), wanted);
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
  EXPECT_EQ(gray.data, proto::read_npy(picture_file("color_gray.npy")).data);

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

TEST(Picture, WhatIsNoneOrDoesNotFitIsSaid) {
  const test::TempDir dir;
  const auto said = [&](const std::string& content) {
    test::write_file(dir / "p", content);
    return picture_error([&] { cli::read_picture(dir / "p"); });
  };
  const std::string p = (dir / "p").string();
  EXPECT_EQ(said("GIF89a"), p + ": not a picture: expected PNG or JPEG");
  EXPECT_EQ(said(std::string("\x89PNG\r\n\x1a\n")), p + ": not a PNG picture: it ends too early");
  const std::string png = test::read_file(picture_file("alpha16.png"));
  EXPECT_EQ(said(png.substr(0, png.size() / 2)),
            p + ": the PNG picture is damaged: it ends too early");
  EXPECT_TRUE(said("\xff\xd8\xff").starts_with(p + ": not a JPEG picture: "));
  std::string large = test::read_file(picture_file("color.jpg"));
  large.replace(large.find("\xff\xc0") + 5, 4, "pppp");  // its height and width
  EXPECT_EQ(said(large), p + ": 28784 x 28784 pixels; pictures of up to 67108864 pixels are read");
  EXPECT_NE(
      picture_error([&] { cli::read_picture(dir / "none.png"); }).find("none.png: cannot open"),
      std::string::npos);
  for (const engine::Shape& shape : {engine::Shape{1, 4, 5, 5}, engine::Shape{1, 75}})
    EXPECT_NE(picture_error([&] {
                picture_input({picture_file("color.jpg")}, "data", shape, false);
              }).find("the input 'data' is " + shape.text()),
              std::string::npos);
}

}  // namespace
}  // namespace revisit
