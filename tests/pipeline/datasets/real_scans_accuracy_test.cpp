// References: docs/reference/PAPER.md ("The 12 real scans").
#include "revisit/datasets/describe.h"
#include "revisit/datasets/scan_file.h"
#include "revisit/engine/net.h"
#include "revisit/evaluation/descriptors.h"
#include "revisit/evaluation/precision_recall.h"
#include "revisit/recognition/feature_file.h"
#include "testing.h"

namespace revisit {
namespace {

struct PublishedAnswer {
  int frame;
  double cosine;
  double next;  // cosine of the second; NaN: not given
};

struct Experiment {
  const char* end;    // layer; "": the range image itself
  const char* graft;  // layer
  AlignCase align;
  PublishedAnswer of_4501, of_88;
  int correct;  // best matches within 5 m, of the 11 scans that have one
  double average_precision;
};

FeatureExtractor feature_of(const Experiment& row, const fs::path& model) {
  if (std::string(row.end).empty()) return range_vector_features({});
  const engine::Net net = engine::Net::load(model / "deploy.prototxt", model / "weights.caffemodel",
                                            {.end = row.end, .graft = row.graft});
  return network_features(net, "squeezenet_v1.0", {104, 117, 123}, {});
}

/// Equivalent to `revisit eval --protocol leave-one-out --exclusion none`.
struct Answers {
  Trajectory trajectory;
  Task task;
  std::vector<Match> matches;

  Answers(const Experiment& row, const Dataset& dataset, const fs::path& model) {
    const FeatureExtractor feature = feature_of(row, model);
    const DescribeOptions options{.align = row.align, .threads = 2};
    const TempDir folder;
    const Observer observer;
    DatasetFeatures features(dataset, feature, options, folder.path(), observer);
    trajectory = make_trajectory(dataset);
    task = make_tasks("leave-one-out", "00", trajectory, parse_exclusion("none")).at(0);
    matches = retrieve({fit_pca({&features.file()}).descriptors}, task);
  }

  int frame_of(int64_t row) const { return trajectory.frames[static_cast<size_t>(row)]; }
  void expect(int query, const PublishedAnswer& found) const {
    for (const Match& match : matches) {
      if (frame_of(match.query) != query) continue;
      EXPECT_EQ(frame_of(match.ranks.at(0)), found.frame) << "query " << query;
      EXPECT_NEAR(match.similarities.at(0), found.cosine, 1e-3) << "query " << query;
      if (!std::isnan(found.next)) {
        EXPECT_NEAR(match.similarities.at(1), found.next, 1e-3) << "query " << query;
      }
      return;
    }
    ADD_FAILURE() << "no query " << query;
  }
};

class RealScansAccuracy : public testing::TestWithParam<Experiment> {};

TEST_P(RealScansAccuracy, IsThatOfTheReadme) {
  REVISIT_NEED_SHARED(kitti, "data/kitti");
  REVISIT_NEED_SHARED(model, "data/caffemodels/squeezenet_v1.0");
  const Experiment& row = GetParam();
  const Answers answers(row, open_dataset(kitti, "00", true), model);
  ASSERT_EQ(answers.matches.size(), 12U);
  answers.expect(4501, row.of_4501);
  answers.expect(88, row.of_88);
  const std::vector<MatchLabel> labels =
      label_matches(answers.matches, answers.task, answers.trajectory, answers.task.rule);
  const PrSummary summary = summarize(labels, answers.task.rejected_only);
  EXPECT_EQ(summary.n_positives, 11);
  EXPECT_DOUBLE_EQ(summary.recall_at_1, row.correct / 11.0);
  EXPECT_NEAR(summary.average_precision, row.average_precision, 1e-3);
}

const double kNotGiven = std::nan("");
INSTANTIATE_TEST_SUITE_P(
    Readme, RealScansAccuracy,
    testing::Values(
        Experiment{"fire8/concat",
                   "",
                   AlignCase::kOne,
                   {52, 0.113, -0.039},
                   {94, 0.068, -0.030},
                   11,
                   0.992},
        Experiment{"fire8/concat",
                   "pool8",
                   AlignCase::kOne,
                   {52, 0.114, -0.047},
                   {94, 0.081, -0.011},
                   11,
                   0.992},
        Experiment{"", "", AlignCase::kOne, {52, 0.322, 0.054}, {199, 0.151, kNotGiven}, 10, 0.909},
        Experiment{"fire8/concat",
                   "",
                   AlignCase::kNone,
                   {52, 0.091, -0.060},
                   {94, -0.022, -0.059},
                   11,
                   1.000},
        Experiment{
            "", "", AlignCase::kNone, {52, 0.391, 0.070}, {850, 0.085, kNotGiven}, 10, 0.909}),
    [](const auto& row) {
      const std::string name = std::string(row.param.end).empty() ? "Data"
                               : *row.param.graft                 ? "Fire8Pool8"
                                                                  : "Fire8";
      return name + (row.param.align == AlignCase::kNone ? "NotAligned" : "");
    });

/// Direction x' of a scan in the world, top-down, counter-clockwise [deg].
double world_yaw(const ScanRef& scan, const Pose& T_cam_velo) {
  const Alignment alignment = principal_alignment(read_scan(scan.file));
  const Eigen::Vector3d x_sensor = alignment.R_aligned_sensor.row(0).transpose().cast<double>();
  // Poses have the first camera's world frame: x right, y down, z forward.
  const Eigen::Vector3d x_world = scan.pose->linear() * T_cam_velo.linear() * x_sensor;
  return std::atan2(-x_world.x(), x_world.z()) * 180 / std::numbers::pi;
}

TEST(RealScansAlignment, PrincipalDirectionOfAPlaceRepeats) {
  REVISIT_NEED_SHARED(kitti, "data/kitti");
  const Dataset dataset = open_dataset(kitti, "00", true);
  const Pose T_cam_velo = read_kitti_calibration(kitti / "sequences/00/calib.txt");
  const Trajectory trajectory = make_trajectory(dataset);
  std::vector<double> yaws;
  for (const ScanRef& scan : dataset.scans) yaws.push_back(world_yaw(scan, T_cam_velo));

  std::vector<double> differences;  // of the pairs of scans of one place [deg]
  for (size_t a = 0; a < yaws.size(); ++a)
    for (size_t b = a + 1; b < yaws.size(); ++b)
      if (distance_between(trajectory, static_cast<int64_t>(a), static_cast<int64_t>(b),
                           Distance::kXz) < 5)
        differences.push_back(std::abs(std::remainder(yaws[a] - yaws[b], 360)));
  ASSERT_EQ(differences.size(), 8U);
  std::sort(differences.begin(), differences.end());
  EXPECT_LT((differences[3] + differences[4]) / 2, 2) << "median";
  EXPECT_LT(differences.back(), 3.5);
  RecordProperty("median", std::to_string((differences[3] + differences[4]) / 2));
  RecordProperty("max", std::to_string(differences.back()));
}

}  // namespace
}  // namespace revisit
