#include "revisit/datasets/scan_file.h"
#include "revisit/evaluation/evaluate.h"
#include "testing.h"

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
class PerturbedScans : public testing::Test {
 protected:
  PerturbedScans() {
    const double along[] = {0, 3, 20, 23, 40, 100};
    const float heights[] = {1, 1.1F, 2, 2.2F, 3, 4};
    for (int i = 0; i < 6; ++i) {
      add_scan(drive_, "drive", i, heights[i], i == 5 ? 50.0F : 10.0F);
      drive_.scans.back().pose = Pose(Eigen::Translation3d(0, along[i], 0));
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

  EvaluationResult evaluate(const std::vector<std::string>& texts, bool with_distractors = false) {
    perturbed_.perturbations.clear();
    for (const std::string& text : texts)
      perturbed_.perturbations.push_back(parse_perturbation(text));
    perturbed_.distractors.clear();
    if (with_distractors) perturbed_.distractors.push_back(elsewhere_);
    return evaluate(Observer());
  }
  EvaluationResult evaluate(const Observer& observer) {
    Trajectory trajectory = make_trajectory(drive_);
    trajectory.listed = listed_;
    return evaluate_perturbed(drive_, trajectory, extractor_, perturbed_, options_, observer);
  }

  /// `counts`: self, queries, neighbor, positives.
  static void expect_task(const TaskResult& task, std::array<int64_t, 4> counts, double median,
                          double least) {
    EXPECT_EQ((std::array{task.perturbed->self, task.summary.n_queries, task.perturbed->neighbor,
                          task.summary.n_positives}),
              counts);
    EXPECT_NEAR(task.perturbed->ratio_median, median, 1e-4);
    EXPECT_NEAR(task.perturbed->ratio_min, least, 1e-4);
  }

  TempDir dir_;
  Dataset drive_, elsewhere_;
  FeatureExtractor extractor_ = highest_point();
  PerturbedQueries perturbed_;
  EvaluationOptions options_;
  std::optional<ListedPairs> listed_;
};

TEST_F(PerturbedScans, FiguresByHand) {
  const EvaluationResult result = evaluate({"none", "height=0.5"});
  EXPECT_EQ(result.tasks[0].task.stored.size(), 6U);
  EXPECT_EQ(result.tasks[0].descriptor_dim, 1);
  ASSERT_EQ(result.tasks.size(), 2u);
  // 1/1.1 to 1/2, 1/1.1 to 1/1.9, 1/1.2 to 1/1.9, 1/1.2 to 1/1.8
  expect_task(result.tasks[0], {6, 6, 4, 4}, (1.9 / 1.1 + 1.9 / 1.2) / 2, 1.8 / 1.2);
  // Only the last two of 1.5, 1.6, 2.5, 2.7, 3.5, 4.5 find themselves (3.5 is as near to 4, which
  // comes later). 1/1.4 to 1/1.5, 1/1.6 to 1/1.4, 1/1.3 to 1/1.5, 1/1.7 to 1/1.3
  expect_task(result.tasks[1], {2, 6, 2, 4}, (1.5 / 1.4 + 1.4 / 1.6) / 2, 1.3 / 1.7);
  EXPECT_EQ(result.tasks[0].summary.recall_at_1, 1);
  EXPECT_EQ(result.tasks[0].summary.average_precision, 1);
  // 2 c1 - c4: 2.7 is incorrect with 1.15, 1.5 correct with 1.14, 3.5 incorrect with 1.04, 2.5
  // correct with 1.03, 1.6 and 4.5 incorrect: AP = (1/2 + 2/4) / 4.
  EXPECT_EQ(result.tasks[1].summary.recall_at_1, 0.5);
  EXPECT_DOUBLE_EQ(result.tasks[1].summary.average_precision, 0.25);
}

TEST_F(PerturbedScans, ListedQueriesAreAskedAmongTheScansBeforeThem) {
  for (ScanRef& scan : drive_.scans) scan.pose.reset();
  listed_ = {{{1, {0}}, {3, {2}}}, {}, false};
  const TaskResult row = evaluate({"none"}).tasks[0];
  expect_task(row, {2, 2, 2, 2}, 2.1 / 1.2, 2.1 / 1.2);  // 2.2 to 2 and to 1.1; 1.1 has no other
  EXPECT_EQ(row.summary.recall_at_1, 1);
  listed_->correct = {{5, {0}}};
  EXPECT_EQ(evaluate({"none"}).tasks[0].summary.recall_at_1, 0) << "4 is nearer to 3";
}

TEST_F(PerturbedScans, OtherPlacesMayBeFound) {
  const EvaluationResult result = evaluate({"none", "height=0.5"}, true);
  EXPECT_EQ(result.tasks[0].task.stored.size(), 7U);
  // The other place is at 1.5: 1/1.1 to 1/1.5, 1/1.1 to 1/1.4, 1/1.2 to 1/1.5, 1/1.2 to 1/1.7
  expect_task(result.tasks[0], {6, 6, 4, 4}, (1.5 / 1.1 + 1.4 / 1.1) / 2, 1.5 / 1.2);
  EXPECT_EQ(result.tasks[1].perturbed->neighbor, 1)
      << "1.5 and 1.6 are lost to it, 2.7 was lost before";
}

TEST_F(PerturbedScans, ExcludesScansNearInTime) {
  options_.exclusion = parse_exclusion("frames=1");
  const TaskResult row = evaluate({"none"}).tasks[0];
  EXPECT_EQ(row.perturbed->self, 6) << "its own original is searched among all";
  EXPECT_EQ(row.summary.n_positives, 0);
  EXPECT_TRUE(std::isnan(row.perturbed->ratio_median));
  EXPECT_TRUE(std::isnan(row.perturbed->ratio_min));
}

TEST_F(PerturbedScans, BetweenRadiusAndOtherPlacesIsNeither) {
  options_.negative_radius = 30;
  // Scans at 0 and 3 m: others are those at 40 and 100 m; of 20 and 23 m there is one, at 100 m.
  // 1/1.1 to 1/3, 1/1.1 to 1/2.9, 1/1.2 to 1/3, 1/1.2 to 1/2.8
  expect_task(evaluate({"none"}).tasks[0], {6, 6, 4, 4}, (3 / 1.2 + 2.9 / 1.1) / 2, 2.8 / 1.2);
}

TEST_F(PerturbedScans, QueriesAreSpreadOverTheDrive) {
  perturbed_.n = 2;  // the scans at 3 and at 40 m
  expect_task(evaluate({"none"}).tasks[0], {2, 2, 1, 1}, 1.9 / 1.1, 1.9 / 1.1);
  perturbed_.n = 100;
  EXPECT_EQ(evaluate({"none"}).tasks[0].summary.n_queries, 6);
}

TEST_F(PerturbedScans, ScansThatAreGoneFindNothing) {
  const EvaluationResult result = evaluate({"range=30", "range=5"});
  EXPECT_EQ(result.tasks[0].perturbed->skipped, 1);
  EXPECT_EQ(result.tasks[0].perturbed->self, 5);
  EXPECT_EQ(result.tasks[0].summary.n_queries, 6);
  EXPECT_EQ(result.tasks[0].perturbed->neighbor, 4);
  EXPECT_EQ(result.tasks[1].perturbed->skipped, 6);
  expect_task(result.tasks[1], {0, 6, 0, 4}, 0, 0);
}

TEST_F(PerturbedScans, AScanThatWasNeverReadableIsLeftOut) {
  write_file(drive_.scans[2].file, std::string(32, '\0'));
  const EvaluationResult result = evaluate({"none"});
  EXPECT_EQ(result.skipped, std::vector<int64_t>{2});
  EXPECT_EQ(result.tasks[0].task.stored.size(), 5U);
  EXPECT_EQ(result.tasks[0].summary.n_queries, 5);
  EXPECT_EQ(result.tasks[0].summary.n_positives, 2);
}

TEST_F(PerturbedScans, AnotherSeedAltersOtherwiseAndOneIsKept) {
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

TEST_F(PerturbedScans, AStoppedCallGoesOn) {
  bool enough = false;
  Observer observer;
  observer.stop = [&] { return enough; };
  observer.stage = [&](const char* verb, const char*) -> Progress {
    if (std::string(verb) != "perturbing") return [](int64_t, int64_t) {};
    return [&](int64_t done, int64_t) { enough = done >= 7; };
  };
  perturbed_.perturbations = {parse_perturbation("none"), parse_perturbation("height=0.5")};
  EXPECT_THROW(evaluate(observer), Interrupted);
  int64_t first = -1;
  observer.stop = {};
  observer.stage = [&](const char* verb, const char*) -> Progress {
    if (std::string(verb) != "perturbing") return [](int64_t, int64_t) {};
    return [&](int64_t done, int64_t total) {
      if (first < 0) first = done;
      EXPECT_EQ(total, 12);
    };
  };
  const EvaluationResult result = evaluate(observer);
  EXPECT_GT(first, 0) << "what was done is kept";
  EXPECT_EQ(result.tasks[1].perturbed->self, 2);
}

/// The PCA is fitted to unperturbed scans, and perturbed ones are projected.
TEST_F(PerturbedScans, ReducedFeaturesAreOfOneBasis) {
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
  const EvaluationResult result = evaluate({"none", "height=0.01", "height=3"});
  EXPECT_EQ(result.tasks[0].descriptor_dim, 4);
  EXPECT_EQ(result.tasks[0].perturbed->self, 6);
  EXPECT_EQ(result.tasks[1].perturbed->self, 6);
  EXPECT_LT(result.tasks[2].perturbed->self, 3);
}

TEST_F(PerturbedScans, RejectsInvalidOptions) {
  const auto expect_rejected = [&](const std::string& part) {
    expect_error<UsageError>([&] { evaluate(Observer()); }, {part});
  };
  perturbed_.perturbations = {};
  expect_rejected("at least one perturbation");
  perturbed_ = {};
  perturbed_.n = -1;
  expect_rejected("at least 0 queries");
  perturbed_ = {};
  options_.radius = 0;
  expect_rejected("a radius above 0");
  options_ = {};
  options_.query_case = QueryCase::kBoth;
  options_.describe.align = AlignCase::kNone;
  expect_rejected("both alignment cases need align case1");
  options_ = {};
  drive_.scans[3].pose.reset();
  expect_rejected("perturbed scans needs poses");
  extractor_.make = FeatureMaker<GrayImage>();
  expect_rejected("camera images");
}

}  // namespace
}  // namespace revisit
