#include "revisit/datasets/dataset.h"
#include "revisit/datasets/scan_file.h"
#include "small_drive.h"
#include "testing.h"

namespace revisit {
namespace {

GrayImage ramp(int width, int height) {
  GrayImage image{width, height, {}};
  for (int i = 0; i < width * height; ++i) image.pixels.push_back(static_cast<uint8_t>(i * 7));
  return image;
}

TEST(GrayPng, RoundTrips) {
  const TempDir dir;
  write_gray_png(dir / "a.png", ramp(31, 17));
  const GrayImage image = read_gray_png(dir / "a.png");
  EXPECT_EQ(image.width, 31);
  EXPECT_EQ(image.height, 17);
  EXPECT_EQ(image.pixels, ramp(31, 17).pixels);
}

TEST(GrayPng, DamageIsAnError) {
  const TempDir dir;
  write_gray_png(dir / "a.png", ramp(100, 100));
  const std::string good = read_file(dir / "a.png");
  const auto expect = [&](const std::string& bytes, const char* part) {
    write_file(dir / "b.png", bytes);
    expect_error<InputError>([&] { read_gray_png(dir / "b.png"); }, {"b.png", part});
  };
  expect("", "PNG");
  expect("P5 2 2 255 abcd", "PNG");
  expect(good.substr(0, good.size() / 2), "corrupt");
  std::string wrong = good;
  wrong[good.size() / 2] ^= 0x55;
  expect(wrong, "corrupt");
  // A header of 65,536 x 65,536 pixels must be rejected before memory is allocated.
  std::string huge = good;
  std::memcpy(huge.data() + 16, "\0\1\0\0\0\1\0\0", 8);
  write_file(dir / "b.png", huge);
  expect_error<InputError>([&] { read_gray_png(dir / "b.png"); }, {"b.png"});
  expect_error<InputError>([&] { read_gray_png(dir / "none.png"); }, {"none.png"});
}

TEST(GrayPng, TooManyPixelsAreRefused) {
  const TempDir dir;
  write_gray_png(dir / "a.png", {5000, 1000, std::vector<uint8_t>(5'000'000)});
  expect_error<InputError>([&] { read_gray_png(dir / "a.png"); }, {"5000 x 1000", "reduce"});
}

class CameraImages : public testing::Test {
 protected:
  CameraImages() {
    write_small_drive(dir_.path(), 4);
    dataset_ = open_dataset(dir_.path(), "00");
  }
  std::filesystem::path images() const { return dir_ / "sequences/00/image_0"; }
  const TempDir dir_;
  Dataset dataset_;
};

TEST_F(CameraImages, TakeThePlaceOfTheScans) {
  for (const char* name : {"3.png", "000000.png", "0001.png", "02.png", "000009.png"})
    write_file(images() / name, "");
  const Dataset cameras = camera_images(dataset_);
  ASSERT_EQ(cameras.scans.size(), 4U);
  for (size_t i = 0; i < 4; ++i) {
    EXPECT_EQ(cameras.scans[i].frame, dataset_.scans[i].frame);
    EXPECT_TRUE(cameras.scans[i].pose);
  }
  EXPECT_EQ(cameras.scans[1].file, images() / "0001.png");
  EXPECT_EQ(cameras.scans[3].file, images() / "3.png");
}

TEST_F(CameraImages, MissingOnesAreNamed) {
  expect_error<InputError>([&] { camera_images(dataset_); }, {"image_0", "no such folder"});
  std::filesystem::create_directories(images());
  expect_error<InputError>([&] { camera_images(dataset_); }, {"image_0", "no images"});
  write_file(images() / "000000.png", "");
  expect_error<InputError>([&] { camera_images(dataset_); }, {"frame 1", "000001.bin"});
  write_file(images() / "left.png", "");
  expect_error<InputError>([&] { camera_images(dataset_); }, {"left.png", "000123.png"});
  std::filesystem::rename(dir_ / "sequences/00/velodyne", dir_ / "scans");
  expect_error<InputError>([&] { camera_images(open_dataset(dir_ / "scans", "")); },
                           {"scans", "pass the folder"});
}

}  // namespace
}  // namespace revisit
