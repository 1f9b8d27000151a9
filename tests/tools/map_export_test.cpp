#include <numbers>

#include "loops/map_graph.h"
#include "testing.h"

namespace revisit::cli {
namespace {

using Eigen::Isometry3d;
using Eigen::Vector3d;

Isometry3d pose(double x, double y, double yaw) {
  return Isometry3d(Eigen::Translation3d(x, y, 0.1 * x)) *
         Eigen::AngleAxisd(yaw, Vector3d::UnitZ()) * Eigen::AngleAxisd(0.1, Vector3d::UnitX());
}

Eigen::Matrix<double, 6, 6> precise() {
  return 1e4 * Eigen::Matrix<double, 6, 6>::Identity();
}

/// Two laps of a square of 40 m by odometry that turns too far; loops from the second to the first.
TEST(PoseGraph, LoopsCorrectDriftDespiteAnIncorrectOne) {
  constexpr int kLap = 40;
  std::vector<Isometry3d> truth, drifted;
  Isometry3d at = pose(5, -3, 1);
  std::vector<PoseEdge> edges;
  for (int i = 0; i < 2 * kLap; ++i) {
    truth.push_back(at);
    Isometry3d step(Eigen::Translation3d(1, 0, 0));
    if (i % 10 == 9) step.rotate(Eigen::AngleAxisd(std::numbers::pi / 2, Vector3d::UnitZ()));
    at = at * step;
    const Isometry3d wrong = step * Eigen::AngleAxisd(0.002, Vector3d(1, 2, 20).normalized());
    drifted.push_back(i == 0 ? truth[0] : drifted.back() * edges.back().T_from_to);
    edges.push_back({static_cast<size_t>(i), static_cast<size_t>(i) + 1, wrong,
                     odometry_information(wrong), false});
  }
  edges.pop_back();
  const auto largest_error = [&] {
    double largest = 0;
    for (size_t i = 0; i < truth.size(); ++i)
      largest = std::max(largest, (drifted[i].translation() - truth[i].translation()).norm());
    return largest;
  };
  EXPECT_GT(largest_error(), 1);
  for (size_t i = 0; i < kLap; i += 4)
    edges.push_back({i, i + kLap, truth[i].inverse() * truth[i + kLap], precise(), true});
  edges.push_back({3, 60, Isometry3d::Identity(), precise(), true});
  optimize(edges, drifted);
  EXPECT_TRUE(drifted[0].isApprox(truth[0], 1e-6));
  EXPECT_LT(largest_error(), 0.5);
}

TEST(PoseGraph, VarianceOfOdometryGrowsWithTheStep) {
  const auto variance = [](double meters) {
    const Isometry3d step(Eigen::Translation3d(0, meters, 0));
    return Vector3d(odometry_information(step).diagonal().cwiseInverse().head<3>()).norm();
  };
  EXPECT_DOUBLE_EQ(variance(20), 10 * variance(2));
  EXPECT_DOUBLE_EQ(variance(0), variance(0.1));
}

class MapExport : public testing::Test {
 protected:
  std::string path(const std::string& name) const { return (folder_ / name).string(); }
  MapEntry entry(const std::string& drive, int64_t frame, const std::optional<Isometry3d>& at) {
    return {.drive = drive, .frame = frame, .pose = at, .descriptor = {1}};
  }
  void store(const std::vector<MapEntry>& entries) const {
    const MapFingerprint fingerprint{{"feature", "numbers"}};
    open_map(path("a.map"), MapAccess::kWrite, &fingerprint)->add(entries);
  }
  test::TempDir folder_;
};

/// The second drive has another origin; a scan without a pose has a loop; a loop is questioned.
TEST_F(MapExport, DrivesShareAWorld) {
  const Isometry3d T_first_second = pose(100, 50, 2);
  std::vector<MapEntry> entries;
  for (int i = 0; i < 10; ++i) entries.push_back(entry("monday", i, pose(i, 0, 0)));
  for (int i = 0; i < 10; ++i) {
    entries.push_back(entry("tuesday", i, T_first_second.inverse() * pose(i, 1, 3)));
    entries.back().loops = {{i + 1, pose(i, 0, 0).inverse() * pose(i, 1, 3), precise()}};
  }
  entries[15].loops[0].T_place_query = Isometry3d::Identity();
  entries[16].questioned = {16};
  entries.push_back(entry("", 3, std::nullopt));
  entries.back().loops = {{1, pose(0, 2, 0), precise()}};
  entries.push_back(entry("", 4, std::nullopt));
  store(entries);
  const MapGraph graph = graph_of(*open_map(path("a.map"), MapAccess::kRead));
  ASSERT_EQ(graph.entries.size(), 21);
  EXPECT_EQ(graph.loops, 10);
  for (size_t i = 0; i < 10; ++i) {
    EXPECT_TRUE(graph.entries[i].pose->isApprox(pose(static_cast<double>(i), 0, 0), 0.01)) << i;
    EXPECT_TRUE(graph.entries[10 + i].pose->isApprox(pose(static_cast<double>(i), 1, 3), 0.01));
  }
  EXPECT_TRUE(graph.entries[20].pose->isApprox(pose(0, 0, 0) * pose(0, 2, 0), 0.01));

  const auto command = [&](const std::string& options, int code, const std::string& message) {
    const auto result = test::run_revisit("map export " + path("a.map") + options);
    EXPECT_EQ(result.exit_code, code) << result.err;
    EXPECT_HAS(result.out + result.err, message);
  };
  command(" --g2o " + path("a.g2o") + " --tum " + path("a.tum"), 0,
          "21 entries of 3 drives, 10 loops");
  const auto count = [&](const std::string& file, const std::string& word) {
    int n = 0;
    std::istringstream lines(test::read_file(path(file)));
    for (std::string line; std::getline(lines, line);) n += line.starts_with(word) ? 1 : 0;
    return n;
  };
  EXPECT_EQ(count("a.g2o", "VERTEX_SE3:QUAT "), 21);
  EXPECT_EQ(count("a.g2o", "EDGE_SE3:QUAT "), 9 + 9 + 10);
  EXPECT_EQ(count("a.tum", ""), 21);
  command("", 2, "nothing to export");
  command(" --cloud a.pcd", 2, ".ply");
  command(" --cloud " + path("a.ply"), 3, "no readable points");
}

}  // namespace
}  // namespace revisit::cli
