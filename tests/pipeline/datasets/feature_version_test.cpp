// Features cached by an earlier version must not be reused after a change.
#include <unistd.h>

#include <bit>

#include "revisit/base/hash.h"
#include "revisit/baselines/baselines.h"
#include "revisit/datasets/describe.h"
#include "revisit/evaluation/evaluate.h"
#include "revisit/recognition/range_image.h"
#include "testing.h"

namespace revisit {
namespace {

/// Returns 4096 points of a crooked room, from integers alone.
PointCloud fixed_scan() {
  PointCloud cloud;
  uint32_t state = 1;
  const auto next = [&](int range) {
    state = state * 1664525U + 1013904223U;
    return static_cast<int>(state >> 8) % range;
  };
  for (int i = 0; i < 4096; ++i) {
    const auto along = static_cast<float>(next(6000) - 2000) / 100;
    const auto across = static_cast<float>(i % 2 ? 800 : -600) / 100 + along / 8;
    const auto up = static_cast<float>(next(400) - 170) / 100;
    cloud.points.push_back({along, across, up, 0});
  }
  return cloud;
}

std::string checksum(std::span<const float> values) {
  uint64_t hash = kFnv1aStart;
  for (const float value : values) hash = fnv1a(hash, std::bit_cast<uint32_t>(value));
  char text[17];
  std::snprintf(text, sizeof text, "%016llx", static_cast<unsigned long long>(hash));
  return text;
}

std::string image_checksum(AlignCase mode) {
  return checksum(scan_to_image(fixed_scan(), mode, sensor_geometry("hdl64")).pixels);
}

// If one of these fails because of an intended change: increment kFeatureVersion, and enter the new
// version and checksum here. (Pixels have the same bits on every CPU.)
TEST(FeatureVersion, IsRaisedWhenPixelsChange) {
  EXPECT_EQ(kFeatureVersion, 3);
  EXPECT_EQ(image_checksum(AlignCase::kNone), "e564e7350f2d357b");
  EXPECT_EQ(image_checksum(AlignCase::kOne), "dcdf1cc1509bab1d");
  EXPECT_EQ(image_checksum(AlignCase::kTwo), "ed409cbef57b9309");
}

TEST(FeatureVersion, IsRaisedWhenScanContextChanges) {
  EXPECT_EQ(kFeatureVersion, 3);
  const FeatureExtractor extractor = scan_context_features();
  std::vector<float> feature(static_cast<size_t>(extractor.dim));
  std::get<FeatureMaker<PointCloud>>(extractor.make)()(fixed_scan(), feature);
  EXPECT_EQ(checksum(feature), "e3a9098ec49b1ace");
}

class FeatureKeys : public testing::Test {
 protected:
  FeatureKeys() {
    write_file(file(), std::string(160, 'a'));
    dataset_.scans.push_back({file(), 0, {}, {}, ""});
  }
  fs::path file() const { return dir_ / "0.bin"; }
  DatasetFeatures features() const { return {dataset_, extractor_, {}, dir_.path(), observer_}; }

  const TempDir dir_;
  Dataset dataset_;
  const FeatureExtractor extractor_ = range_vector_features({});
  const Observer observer_;
};

TEST_F(FeatureKeys, NameTheVersionOfTheCode) {
  EXPECT_TRUE(features().key().starts_with("version " + std::to_string(kFeatureVersion) + "\n"));
}

TEST_F(FeatureKeys, ACopiedTimeDoesNotHideAChange) {
  const fs::path before = features().path();
  EXPECT_EQ(features().path(), before);
  const fs::file_time_type time = fs::last_write_time(file());
  ::usleep(20000);  // longer than a tick of the clock of files
  write_file(file(), std::string(160, 'b'));
  fs::last_write_time(file(), time);
  const fs::path written = features().path();
  EXPECT_NE(written, before) << "written over";

  write_file(dir_ / "other", std::string(160, 'c'));
  fs::last_write_time(dir_ / "other", time);
  fs::rename(dir_ / "other", file());
  EXPECT_NE(features().path(), written) << "put in its place";
}

TEST_F(FeatureKeys, TellPosesAndTimesApart) {
  const auto key = [&](double x, double time) {
    Trajectory trajectory;
    trajectory.frames = {0};
    trajectory.positions = {{x, 0, 0}};
    trajectory.times = {time};
    EvaluationOptions options;
    options.cache = dir_ / "cache";
    return Evaluation(dataset_, extractor_, trajectory, {}, options).key();
  };
  const std::string before = key(5428123.25, 1.7e9);
  EXPECT_EQ(before, key(5428123.25, 1.7e9));
  EXPECT_NE(before, key(5428123.5, 1.7e9));
  EXPECT_NE(before, key(5428123.25, 1.7e9 + 0.1));
}

}  // namespace
}  // namespace revisit
