#include "revisit/evaluation/robustness.h"

#include <gtest/gtest.h>

#include <array>
#include <cmath>

#include "expect_error.h"
#include "revisit/base/error.h"
#include "revisit/datasets/scan_file.h"
#include "test_data.h"

namespace revisit {
namespace {

/// Similarity is 1 / (1 + difference).
FeatureExtractor highest_point() {
  FeatureExtractor extractor;
  extractor.name = extractor.key = "highest point";
  extractor.dim = 1;
  extractor.make = FeatureMaker<PointCloud>([] {
    return [](const PointCloud& cloud, std::span<float> feature) {
      feature[0] = -1000;
      for (const Point& p : cloud.points) feature[0] = std::max(feature[0], p.z);
    };
  });
  extractor.comparison.similarity = [](std::span<const float> query, auto places, auto found) {
    for (size_t i = 0; i < places.size(); ++i)
      found[i] = 1 / (1 + std::abs(double{query[0]} - places[i][0]));
  };
  return extractor;
}

/// Two places seen twice each, and two seen once, the last one from far away.
class Robustness : public testing::Test {
 protected:
  Robustness() {
    const double along[] = {0, 3, 20, 23, 40, 100};
    const float heights[] = {1, 1.1F, 2, 2.2F, 3, 4};
    for (int i = 0; i < 6; ++i) {
      add_scan(drive_, "drive", i, heights[i], i == 5 ? 50.0F : 10.0F);
      drive_.scans.back().pose = Pose(Eigen::Translation3d(0, 0, along[i]));
    }
    add_scan(elsewhere_, "elsewhere", 0, 1.5F, 10);
    options_.cache = dir_ / "cache";
    options_.describe.align = AlignCase::kNone;
  }

  void add_scan(Dataset& dataset, const std::string& folder, int frame, float height, float range) {
    ScanRef scan;
    scan.frame = frame;
    scan.file = dir_ / folder / (std::to_string(frame) + ".bin");
    std::filesystem::create_directories(scan.file.parent_path());
    write_kitti_scan(scan.file, {{{range, 0, height, 0}, {0, range, height - 1, 0}}});
    dataset.scans.push_back(scan);
  }

  RobustnessResult ask(const std::vector<std::string>& texts, bool among = false) {
    options_.perturbations.clear();
    for (const std::string& text : texts)
      options_.perturbations.push_back(parse_perturbation(text));
    std::vector<Dataset> others;
    if (among) others.push_back(elsewhere_);
    return robustness(drive_, others, extractor_, options_);
  }

  static void expect_row(const RobustnessRow& row, std::array<int64_t, 4> counts, double median,
                         double least) {
    EXPECT_EQ((std::array{row.own, row.n_queries, row.near, row.queries_with_neighbor}), counts);
    EXPECT_NEAR(row.ratio_median, median, 1e-4);
    EXPECT_NEAR(row.ratio_min, least, 1e-4);
  }

  test::TempDir dir_;
  Dataset drive_, elsewhere_;
  FeatureExtractor extractor_ = highest_point();
  RobustnessOptions options_;
};

TEST_F(Robustness, FiguresByHand) {
  const RobustnessResult result = ask({"none", "height=0.5"});
  EXPECT_EQ(result.stored, 6);
  EXPECT_EQ(result.numbers, 1);
  ASSERT_EQ(result.rows.size(), 2u);
  // 1/1.1 to 1/2, 1/1.1 to 1/1.9, 1/1.2 to 1/1.9, 1/1.2 to 1/1.8
  expect_row(result.rows[0], {6, 6, 4, 4}, (1.9 / 1.1 + 1.9 / 1.2) / 2, 1.8 / 1.2);
  // Only the last two of 1.5, 1.6, 2.5, 2.7, 3.5, 4.5 find themselves (3.5 is as near to 4, which
  // comes later). 1/1.4 to 1/1.5, 1/1.6 to 1/1.4, 1/1.3 to 1/1.5, 1/1.7 to 1/1.3
  expect_row(result.rows[1], {2, 6, 2, 4}, (1.5 / 1.4 + 1.4 / 1.6) / 2, 1.3 / 1.7);
  EXPECT_EQ(result.rows[0].recall_at_1, 1);
  EXPECT_EQ(result.rows[0].average_precision, 1);
  // 2 c1 - c4: 2.7 is incorrect with 1.15, 1.5 correct with 1.14, 3.5 incorrect with 1.04, 2.5
  // correct with 1.03, 1.6 and 4.5 incorrect: AP = (1/2 + 2/4) / 4.
  EXPECT_EQ(result.rows[1].recall_at_1, 0.5);
  EXPECT_DOUBLE_EQ(result.rows[1].average_precision, 0.25);
}

TEST_F(Robustness, ListedQueriesAreAskedAmongTheScansBeforeThem) {
  for (ScanRef& scan : drive_.scans) scan.pose.reset();
  options_.listed = {{{1, {0}}, {3, {2}}}, {}, false};
  const RobustnessRow row = ask({"none"}).rows[0];
  expect_row(row, {2, 2, 2, 2}, 2.1 / 1.2, 2.1 / 1.2);  // 2.2 to 2 and to 1.1; 1.1 has no other
  EXPECT_EQ(row.recall_at_1, 1);
  options_.listed->correct = {{5, {0}}};
  EXPECT_EQ(ask({"none"}).rows[0].recall_at_1, 0) << "4 is nearer to 3";
}

TEST_F(Robustness, OtherPlacesMayBeFound) {
  const RobustnessResult result = ask({"none", "height=0.5"}, true);
  EXPECT_EQ(result.stored, 7);
  // The other place is at 1.5: 1/1.1 to 1/1.5, 1/1.1 to 1/1.4, 1/1.2 to 1/1.5, 1/1.2 to 1/1.7
  expect_row(result.rows[0], {6, 6, 4, 4}, (1.5 / 1.1 + 1.4 / 1.1) / 2, 1.5 / 1.2);
  EXPECT_EQ(result.rows[1].near, 1) << "1.5 and 1.6 are lost to it, 2.7 was lost before";
}

TEST_F(Robustness, WhatIsNearInTimeIsLeftOut) {
  options_.exclusion = parse_exclusion("frames=1");
  const RobustnessRow row = ask({"none"}).rows[0];
  EXPECT_EQ(row.own, 6) << "its own original is searched among all";
  EXPECT_EQ(row.queries_with_neighbor, 0);
  EXPECT_TRUE(std::isnan(row.ratio_median));
  EXPECT_TRUE(std::isnan(row.ratio_min));
}

TEST_F(Robustness, BetweenRadiusAndOtherPlacesIsNeither) {
  options_.rule.false_beyond = 30;
  // Scans at 0 and 3 m: others are those at 40 and 100 m; of 20 and 23 m there is one, at 100 m.
  // 1/1.1 to 1/3, 1/1.1 to 1/2.9, 1/1.2 to 1/3, 1/1.2 to 1/2.8
  expect_row(ask({"none"}).rows[0], {6, 6, 4, 4}, (3 / 1.2 + 2.9 / 1.1) / 2, 2.8 / 1.2);
}

TEST_F(Robustness, QueriesAreSpreadOverTheDrive) {
  options_.queries = 2;  // the scans at 3 and at 40 m
  expect_row(ask({"none"}).rows[0], {2, 2, 1, 1}, 1.9 / 1.1, 1.9 / 1.1);
  options_.queries = 100;
  EXPECT_EQ(ask({"none"}).rows[0].n_queries, 6);
}

TEST_F(Robustness, ScansThatAreGoneFindNothing) {
  const RobustnessResult result = ask({"range=30", "range=5"});
  EXPECT_EQ(result.rows[0].not_described, 1);
  EXPECT_EQ(result.rows[0].own, 5);
  EXPECT_EQ(result.rows[0].n_queries, 6);
  EXPECT_EQ(result.rows[0].near, 4);
  EXPECT_EQ(result.rows[1].not_described, 6);
  expect_row(result.rows[1], {0, 6, 0, 4}, 0, 0);
}

TEST_F(Robustness, AScanThatWasNeverReadableIsLeftOut) {
  test::write_file(drive_.scans[2].file, std::string(32, '\0'));
  const RobustnessResult result = ask({"none"});
  EXPECT_EQ(result.skipped, std::vector<int64_t>{2});
  EXPECT_EQ(result.stored, 5);
  EXPECT_EQ(result.rows[0].n_queries, 5);
  EXPECT_EQ(result.rows[0].queries_with_neighbor, 2);
}

TEST_F(Robustness, AnotherSeedAltersOtherwiseAndOneIsKept) {
  Dataset last;  // A perturbation does not depend on the other scans
  last.scans.push_back(drive_.scans[4]);
  const auto feature_of = [&](const Dataset& dataset, uint32_t seed) {
    DescribeOptions how = options_.describe;
    how.perturbation = parse_perturbation("noise=0.5");
    how.seed = seed;
    const Observer observer;
    DatasetFeatures features(dataset, extractor_, how, dir_.path(), observer);
    return features.file().row(features.n() - 1)[0];
  };
  Dataset five = drive_;
  five.scans.pop_back();
  EXPECT_EQ(feature_of(five, 1), feature_of(last, 1));
  EXPECT_NE(feature_of(last, 1), feature_of(last, 2));
  EXPECT_NE(feature_of(last, 1), 3) << "it is altered";
}

TEST_F(Robustness, AStoppedCallGoesOn) {
  bool enough = false;
  Observer observer;
  observer.stop = [&] { return enough; };
  observer.stage = [&](const char* verb, const char*) -> Progress {
    if (std::string(verb) != "altering") return [](int64_t, int64_t) {};
    return [&](int64_t done, int64_t) { enough = done >= 7; };
  };
  options_.perturbations = {parse_perturbation("none"), parse_perturbation("height=0.5")};
  EXPECT_THROW(robustness(drive_, {}, extractor_, options_, observer), Interrupted);
  int64_t first = -1;
  observer.stop = {};
  observer.stage = [&](const char* verb, const char*) -> Progress {
    if (std::string(verb) != "altering") return [](int64_t, int64_t) {};
    return [&](int64_t done, int64_t total) {
      if (first < 0) first = done;
      EXPECT_EQ(total, 12);
    };
  };
  const RobustnessResult result = robustness(drive_, {}, extractor_, options_, observer);
  EXPECT_GT(first, 0) << "what was done is kept";
  EXPECT_EQ(result.rows[1].own, 2);
}

/// The PCA is fitted to unperturbed scans, and perturbed ones are projected.
TEST_F(Robustness, ReducedFeaturesAreOfOneBasis) {
  extractor_.comparison = {};
  extractor_.dim = 6;
  extractor_.key = "heights at ranges";
  extractor_.make = FeatureMaker<PointCloud>([] {
    return [](const PointCloud& cloud, std::span<float> feature) {
      for (size_t i = 0; i < feature.size(); ++i)
        feature[i] = std::exp(-std::abs(cloud.points[0].z - static_cast<float>(i)));
    };
  });
  options_.reduction.components = 4;
  const RobustnessResult result = ask({"none", "height=0.01", "height=3"});
  EXPECT_EQ(result.numbers, 4);
  EXPECT_EQ(result.rows[0].own, 6);
  EXPECT_EQ(result.rows[1].own, 6);
  EXPECT_LT(result.rows[2].own, 3);
}

TEST_F(Robustness, WrongOptionsAreRefused) {
  const auto expect_refused = [&](const std::string& part) {
    test::expect_error<UsageError>([&] { robustness(drive_, {}, extractor_, options_); }, {part});
  };
  options_.perturbations = {};
  expect_refused("at least one perturbation");
  options_ = {};
  options_.queries = -1;
  expect_refused("at least 0 queries");
  options_ = {};
  options_.rule.radius = 0;
  expect_refused("a radius above 0");
  options_ = {};
  options_.both_cases = true;
  options_.describe.align = AlignCase::kNone;
  expect_refused("both alignment cases need DescribeOptions::align case1");
  options_ = {};
  drive_.scans[3].pose.reset();
  expect_refused("robustness needs poses");
  extractor_.make = FeatureMaker<GrayImage>();
  expect_refused("camera images");
}

}  // namespace
}  // namespace revisit
