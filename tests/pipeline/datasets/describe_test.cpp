#include "revisit/datasets/describe.h"

#include <deque>

#include "revisit/datasets/scan_file.h"
#include "revisit/recognition/feature_file.h"
#include "small_drive.h"
#include "testing.h"

namespace revisit {
namespace {

constexpr const char* kNet = R"(
  layer { name: "data" type: "Input" top: "data" input_param { shape { dim: 1 dim: 3 dim: 16 dim: 64 } } }
  layer { name: "pool" type: "Pooling" bottom: "data" top: "pool" pooling_param { pool: AVE kernel_size: 4 stride: 4 } }
)";

class DescribeTest : public testing::Test {
 protected:
  DescribeTest() {
    write_small_drive(dir_.path(), 12);
    write_file(dir_ / "net.prototxt", kNet);
    dataset_ = open_dataset(dir_.path(), "00");
    options_.geometry.width = 64;
    options_.geometry.height = 16;
  }
  FeatureExtractor extractor() const {
    return network_features(engine::Net::load_without_weights(dir_ / "net.prototxt"), "test",
                            {1, 2, 3}, options_.geometry);
  }
  DatasetFeatures features(const std::string& folder) {
    return {dataset_, extractors_.emplace_back(extractor()), options_, dir_ / folder, observer_};
  }

  const TempDir dir_;
  Dataset dataset_;
  DescribeOptions options_;
  Observer observer_;

 private:
  std::deque<FeatureExtractor> extractors_;
};

TEST_F(DescribeTest, NetworkSeesTheGrayImageMinusTheMeans) {
  const FeatureExtractor features = extractor();
  EXPECT_EQ(features.name, "pool");
  ASSERT_EQ(features.dim, 3 * 4 * 16);
  RangeImage image{64, 16, std::vector<float>(64 * 16, 10.0F)};
  std::vector<float> feature(static_cast<size_t>(features.dim));
  std::get<FeatureMaker<RangeImage>>(features.make)()(image, feature);
  EXPECT_EQ(feature[0], 9);
  EXPECT_EQ(feature[64], 8);
  EXPECT_EQ(feature[128], 7);
}

TEST_F(DescribeTest, OneChannelStandsForAllBeforeAConvolution) {
  write_file(dir_ / "net.prototxt", R"(
    layer { name: "data" type: "Input" top: "data" input_param { shape { dim: 1 dim: 3 dim: 16 dim: 64 } } }
    layer { name: "conv" type: "Convolution" bottom: "data" top: "conv"
            convolution_param { num_output: 5 kernel_size: 3 pad: 1 stride: 2 } })");
  const engine::Net net = engine::Net::load_with_random_weights(dir_ / "net.prototxt", 3, {});
  std::mt19937 random(1);
  RangeImage image{64, 16, std::vector<float>(64 * 16)};
  for (float& pixel : image.pixels) pixel = static_cast<float>(random() % 256);
  const std::array<double, 3> mean = {104, 117, 123};

  // Reference: three channels, each minus its mean, in the reference kernels.
  engine::Run run(net.plan({}, {.reference_kernels = true}));
  float* channel = run.input("data").data;
  for (const double m : mean)
    for (const float pixel : image.pixels) *channel++ = pixel - static_cast<float>(m);
  run.forward();
  const auto expected = run.output("conv").values();

  for (const int threads : {1, 2}) {
    const FeatureExtractor features =
        network_features(net, "test", mean, options_.geometry, {.threads = threads});
    ASSERT_EQ(features.dim, static_cast<int64_t>(expected.size()));
    std::vector<float> feature(expected.size());
    std::get<FeatureMaker<RangeImage>>(features.make)()(image, feature);
    for (size_t i = 0; i < feature.size(); ++i) ASSERT_NEAR(feature[i], expected[i], 1e-3) << i;
  }
}

TEST_F(DescribeTest, OneChannelHasTheMeanOfTheGrayImageAndPixelsAScale) {
  std::string text = kNet;
  text.replace(text.find("dim: 3"), 6, "dim: 1");
  write_file(dir_ / "net.prototxt", text);
  const engine::Net net = engine::Net::load_without_weights(dir_ / "net.prototxt");
  const FeatureExtractor features =
      network_features(net, "test", {10, 20, 40}, options_.geometry, {}, 0.5);
  ASSERT_EQ(features.dim, 4 * 16);
  RangeImage image{64, 16, std::vector<float>(64 * 16, 100.0F)};
  std::vector<float> feature(static_cast<size_t>(features.dim));
  std::get<FeatureMaker<RangeImage>>(features.make)()(image, feature);
  EXPECT_FLOAT_EQ(feature[0], (100 - (1.14F + 11.74F + 11.96F)) / 2);
  EXPECT_NE(features.key, network_features(net, "test", {10, 20, 40}, options_.geometry).key);
  EXPECT_NE(features.key, network_features(net, "test", {10, 20, 40}, options_.geometry,
                                           {.precision = engine::Precision::kBf16}, 0.5)
                              .key);
}

TEST_F(DescribeTest, DataIsTheImageItself) {
  const FeatureExtractor features = range_vector_features(options_.geometry);
  ASSERT_EQ(features.dim, 64 * 16);
  const RangeImage image =
      scan_to_image(read_scan(dataset_.scans[0].file), AlignCase::kOne, options_.geometry);
  std::vector<float> feature(static_cast<size_t>(features.dim));
  std::get<FeatureMaker<RangeImage>>(features.make)()(image, feature);
  EXPECT_EQ(feature, image.pixels);
}

TEST_F(DescribeTest, ThreadsDoNotChangeTheBytes) {
  DatasetFeatures one = features("one");
  one.file();
  options_.threads = 3;
  DatasetFeatures three = features("three");
  three.file();
  EXPECT_EQ(read_file(one.path()), read_file(three.path()));
  EXPECT_EQ(one.alignments().size(), 12U);
}

TEST_F(DescribeTest, ThePointsOutsideOfTheImageAreCountedForEachScan) {
  options_.align = AlignCase::kNone;
  options_.geometry.elevation_bottom = -5;
  DatasetFeatures some = features("some");
  const std::vector<AlignmentRecord>& records = some.alignments();
  for (size_t i = 0; i < records.size(); ++i) {
    RangeImage image;
    project_rotated(read_scan(dataset_.scans[i].file), Eigen::Matrix3f::Identity(),
                    options_.geometry, image);
    EXPECT_GT(records[i].outside, 0);
    EXPECT_FLOAT_EQ(records[i].outside, static_cast<float>(image.outside_share())) << i;
  }
}

TEST_F(DescribeTest, EveryStageOfEveryScanIsTimed) {
  options_.threads = 2;
  DatasetFeatures timed = features("timed");
  timed.file();
  const DescribeTimes& times = timed.times();
  double sum = 0;
  for (const auto* stage :
       {&times.read, &times.align, &times.project, &times.close, &times.feature, &times.write}) {
    ASSERT_EQ(stage->size(), 12U);
    for (const double ms : *stage) {
      EXPECT_GT(ms, 0) << "a stage that nobody timed";
      sum += ms;
    }
  }
  EXPECT_GT(times.wall_ms, sum / 4) << "of two threads and the one that writes";
}

TEST_F(DescribeTest, AStoppedRunResumes) {
  DatasetFeatures whole = features("whole");
  whole.file();
  int polls = 0, described = 0;
  observer_.stop = [&] { return ++polls > 2; };
  DatasetFeatures parts = features("parts");
  expect_error<Interrupted>([&] { parts.file(); }, {"of 12 scans", "to resume"});
  EXPECT_FALSE(std::filesystem::exists(parts.path())) << "a half-written file must not look whole";
  observer_.stop = [] { return false; };
  observer_.stage = [&](const char*, const char*) {
    return [&](int64_t done, int64_t) {
      described = described ? described : static_cast<int>(done) + 1;
    };
  };
  parts.file();
  EXPECT_GT(described, 1) << "the scans done before were done again";
  EXPECT_EQ(read_file(whole.path()), read_file(parts.path()));
  described = 0;
  features("parts").file();
  EXPECT_EQ(described, 0) << "nothing was left to do";
}

TEST_F(DescribeTest, OtherSettingsAreOtherFiles) {
  const std::filesystem::path case1 = features("x").path();
  options_.align = AlignCase::kTwo;
  EXPECT_NE(features("x").path(), case1);
  options_.align = AlignCase::kOne;
  options_.geometry.max_range = 60;
  EXPECT_NE(features("x").path(), case1);
}

TEST_F(DescribeTest, TheAlignmentOfAScanTakenAsItIsIsRecordedAsCaseOne) {
  const auto yaw_of_scan_3 = [&](AlignCase align, const char* folder) {
    options_.align = align;
    return features(folder).alignments().at(3).yaw;
  };
  EXPECT_EQ(yaw_of_scan_3(AlignCase::kNone, "as it is"), yaw_of_scan_3(AlignCase::kOne, "one"));
}

TEST_F(DescribeTest, APointFeatureSeesTheAlignedPoints) {
  FeatureExtractor first;
  first.name = first.key = "first point";
  first.dim = 3;
  first.make = []() -> FeatureFunction<PointCloud> {
    return [](const PointCloud& cloud, std::span<float> feature) {
      const Point& p = cloud.points.at(0);
      std::ranges::copy(std::initializer_list<float>{p.x, p.y, p.z}, feature.begin());
    };
  };
  const PointCloud cloud = read_scan(dataset_.scans[3].file);
  for (const AlignCase align : {AlignCase::kNone, AlignCase::kTwo}) {
    options_.align = align;
    DatasetFeatures points(dataset_, first, options_, dir_ / "points", observer_);
    const FeatureFile& file = points.file();
    EXPECT_EQ(points.times().processor.size(), 12U);
    const PointCloud seen =
        align == AlignCase::kNone
            ? cloud
            : rotated(cloud, principal_alignment(cloud, AlignCase::kTwo).R_aligned_sensor);
    EXPECT_EQ(file.row(3)[0], seen.points[0].x);
    EXPECT_EQ(file.row(3)[1], seen.points[0].y);
  }
}

TEST_F(DescribeTest, AScanThatAFeatureRefusesIsNamed) {
  FeatureExtractor refusing;
  refusing.name = refusing.key = "refusing";
  refusing.dim = 1;
  refusing.make = []() -> FeatureFunction<PointCloud> {
    return [](const PointCloud&, std::span<float>) { throw InputError("nothing to see"); };
  };
  options_.strict = true;
  DatasetFeatures refused(dataset_, refusing, options_, dir_.path(), observer_);
  expect_error<InputError>([&] { refused.file(); }, {"000000.bin", "nothing to see"});
}

TEST_F(DescribeTest, ABadScanIsReportedAndSkipped) {
  write_file(dataset_.scans[5].file, "12345");
  std::vector<std::string> warnings;
  observer_.warn = [&](const std::string& warning) { warnings.push_back(warning); };
  for (const int threads : {1, 3}) {
    std::filesystem::remove_all(dir_ / "bad");
    options_.threads = threads;
    DatasetFeatures bad = features("bad");
    for (int64_t i = 0; i < 12; ++i) {
      EXPECT_EQ(bad.alignments()[static_cast<size_t>(i)].described, i == 5 ? 0 : 1);
      const auto row = bad.file().row(i);
      const bool zero = std::all_of(row.begin(), row.end(), [](float x) { return x == 0; });
      EXPECT_EQ(zero, i == 5) << i;
    }
  }
  ASSERT_EQ(warnings.size(), 2u);
  EXPECT_HAS(warnings[0], "000005.bin");
  std::filesystem::remove_all(dir_ / "bad");
  options_.strict = true;
  expect_error<InputError>([&] { features("bad").file(); }, {"000005.bin"});
}

TEST_F(DescribeTest, AFileThatCannotBeReadIsNoBadScan) {
  // A missing file may reappear, so it must not be cached.
  std::filesystem::remove(dataset_.scans[5].file);
  expect_error<InputError>([&] { features("gone").file(); }, {"000005.bin"});
}

TEST_F(DescribeTest, AScanTakenAsItIsNeedsNoDirection) {
  PointCloud equal;
  equal.points.assign(100, {10, 0, 0, 0});
  write_kitti_scan(dataset_.scans[5].file, equal);
  options_.align = AlignCase::kNone;
  DatasetFeatures none = features("none");
  EXPECT_EQ(none.alignments().at(5).described, 1);
  EXPECT_TRUE(std::isnan(none.alignments().at(5).yaw));
}

TEST_F(DescribeTest, AKillBeforeTheRenameDescribesNothingAgain) {
  const std::filesystem::path made = [&] {
    DatasetFeatures features_made = features("made");
    features_made.file();
    return features_made.path();
  }();
  std::filesystem::rename(made, made.string() + ".part");
  DatasetFeatures again = features("made");
  again.file();
  EXPECT_TRUE(features_complete(made, again.key()));
  EXPECT_EQ(again.times().wall_ms, 0) << "no scan was described";
}

TEST_F(DescribeTest, NetsForOtherInputsAreRefused) {
  write_file(dir_ / "net.prototxt",
             "layer { name: 'in' type: 'Input' top: 'x' input_param { shape { dim: 1 dim: 7 "
             "dim: 9 dim: 9 } } }");
  expect_error<InputError>([&] { extractor(); }, {"'x'", "1x7x9x9", "1 x 3"});
}

}  // namespace
}  // namespace revisit
