#include "revisit/datasets/scan_file.h"
#include "small_drive.h"
#include "testing.h"

namespace revisit {
namespace {

/// A wall with a pattern that depends on the place, seen by a camera that drives along it.
GrayImage wall_at(double along) {
  GrayImage image{120, 60, {}};
  for (int row = 0; row < 60; ++row)
    for (int column = 0; column < 120; ++column) {
      const double x = 40 * along + column, y = row;
      const double tile = std::floor(x / 14) * 7 + std::floor(y / 14) * 13;
      const double shade = std::abs(std::sin(tile * tile)) * 180;
      const bool dot = std::hypot(std::fmod(x, 14) - 7, std::fmod(y, 14) - 7) < 2 + shade / 60;
      image.pixels.push_back(static_cast<uint8_t>(dot ? 240 : shade));
    }
  return image;
}

class BaselinesTest : public testing::Test {
 protected:
  BaselinesTest() { write_small_drive(root()); }
  fs::path root() const { return dir_ / "drive"; }
  void write_images(const fs::path& folder, int n = 24) const {
    fs::create_directories(folder);
    for (int i = 0; i < n; ++i) {
      std::string name = std::to_string(i);
      name.insert(0, 6 - name.size(), '0');
      write_gray_png(folder / (name + ".png"), wall_at(20.0 * (i % 12) / 12));
    }
  }
  std::string eval(const std::string& feature, const std::string& more = "") const {
    return "eval " + root().string() + " --feature " + feature +
           " --protocol online --exclusion frames=8 --radius 2 --no-report -o " +
           (dir_ / "results").string() + " " + more;
  }
  std::string run_json() const { return read_file(dir_ / "results/drive_00/latest/run.json"); }

  const TempDir dir_;
};

TEST_F(BaselinesTest, EachGoesThroughTheSamePath) {
  bool has_pcl = true;
  for (const char* feature : {"scan-context", "m2dp", "vfh", "esf", "grsd"}) {
    const auto result = run_revisit(eval(feature, "--format json --threads 1"));
    if (result.err.find("without PCL") != std::string::npos) {
      has_pcl = false;
      continue;
    }
    ASSERT_EQ(result.exit_code, 0) << feature << result.err;
    EXPECT_HAS(result.out, "\"n_positives\": 12");
    EXPECT_HAS(run_json(), "\"frames_per_second\"");
    EXPECT_HAS(run_json(), "\"align\": \"none\"");
    EXPECT_HAS(run_json(), "\"pca_fit\": \"none\"");
  }
  if (!has_pcl) GTEST_SKIP() << "built without PCL: only scan-context and m2dp";
}

TEST_F(BaselinesTest, ScanContextHasASimilarityOfItsOwn) {
  const auto matches = [&](const std::string& more) {
    run_ok(eval("scan-context", more));
    return read_file(dir_ / "results/drive_00/latest/loops_online.csv");
  };
  // One candidate is left by the ring keys, so the next has the minimum similarity.
  EXPECT_HAS(matches("--candidates 1"), ",-1.000000");
  EXPECT_EQ(matches("").find(",-1.000000"), std::string::npos);
}

TEST_F(BaselinesTest, OnRealScans) {
  REVISIT_NEED_SHARED(kitti, "data/kitti");
  const auto top_1 = [&](const std::string& feature) {
    return run_revisit("eval " + kitti.string() + " --sequence 00 --protocol leave-one-out" +
                       " --exclusion none --no-report --format json -o " +
                       (dir_ / "real").string() + " --feature " + feature)
        .out;
  };
  // 11 of the 12 scans have another within 5 m: Scan Context finds all, M2DP all but one.
  EXPECT_HAS(top_1("scan-context"), "\"recall_at_1\": 1,");
  EXPECT_HAS(top_1("m2dp"), "\"recall_at_1\": 0.909");
}

TEST_F(BaselinesTest, ScansWithoutDescriptionAreCounted) {
  // Point spacing is much larger than the radii.
  const auto result = run_revisit(eval("vfh"));
  if (result.err.find("without PCL") != std::string::npos) GTEST_SKIP() << "built without PCL";
  EXPECT_HAS(result.err, "24 of 24 scans have no vfh");
}

TEST_F(BaselinesTest, FabMapOnTheImagesOfTheDrive) {
  write_images(root() / "sequences/00/image_0");
  const auto result = run_revisit(eval("fabmap"));
  if (result.err.find("without OpenCV") != std::string::npos) GTEST_SKIP() << "built without it";
  ASSERT_EQ(result.exit_code, 0) << result.err;
  EXPECT_HAS(result.out, "feature fabmap (400 dimensions");
  const auto number = [](const std::string& json, const std::string& name) {
    const size_t at = json.find("\"" + name + "\": ");
    return at == std::string::npos ? -1 : std::stod(json.substr(at + name.size() + 4));
  };
  const double speed = number(run_json(), "frames_per_second");
  EXPECT_GT(speed, 0);
  EXPECT_GT(number(run_json(), "scans_per_second"), 0);
  const auto again = run_revisit(eval("fabmap", "--format json"));
  EXPECT_HAS(again.out, "\"recall_at_1\": 1");
  EXPECT_NEAR(number(run_json(), "frames_per_second"), speed, 1e-5 * speed)
      << "that of the run that described them";
  EXPECT_EQ(number(run_json(), "scans_per_second"), -1) << "nothing was described this time";
}

TEST_F(BaselinesTest, FabMapWithImagesFromElsewhere) {
  write_images(dir_ / "camera");
  write_images(dir_ / "other");
  const std::string images = "--images " + (dir_ / "camera").string();
  const auto result = run_revisit(eval("fabmap", images + "," + (dir_ / "other").string()));
  if (result.err.find("without OpenCV") != std::string::npos) GTEST_SKIP() << "built without it";
  EXPECT_EQ(result.exit_code, 0) << result.err;
  const auto expect = [&](int code, const std::string& more, const std::string& part) {
    expect_exit(code, {part}, eval("fabmap", more));
  };
  expect(2, images + " --align case1", "camera images");
  expect(2, images + " --pca 20", "--pca");
  expect(3, "", "image_0");
}

TEST_F(BaselinesTest, RejectsInvalidOptions) {
  const auto expect = [&](const std::string& arguments, const std::string& part) {
    expect_exit(2, {part}, arguments);
  };
  expect(eval("scan-contxt"), "did you mean 'scan-context'");
  expect(eval("scan-context", "--pca 20"), "--pca");
  expect(eval("scan-context", "--candidates -1"), "candidates");
  expect(eval("m2dp", "--pca -3"), "--pca");
}

TEST_F(BaselinesTest, PcaAndAlignmentCanBeAskedFor) {
  const auto result = run_ok(eval("m2dp", "--pca 5 --align case1"));
  EXPECT_HAS(result.out, "PCA fitted on all: 24 scans, 5 components");
  EXPECT_HAS(run_json(), "\"align\": \"case1\"");
}

TEST_F(BaselinesTest, DescriptorsAreWrittenAsTheyAre) {
  const fs::path out = dir_ / "out";
  const auto result =
      run_ok("eval " + root().string() + " --feature m2dp --descriptors " + out.string());
  EXPECT_HAS(result.out, "m2dp (192 dimensions)");
  EXPECT_FALSE(fs::exists(out / "pca"));
  EXPECT_EQ(fs::file_size(out / "descriptors.npy") / 4 / 192, 24U);
}

}  // namespace
}  // namespace revisit
