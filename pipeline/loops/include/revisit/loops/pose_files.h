#pragma once

#include <Eigen/Geometry>
#include <filesystem>
#include <fstream>
#include <optional>
#include <set>
#include <string>
#include <vector>

namespace revisit {

/// Text file that flushes each line.
class PoseFile {
 public:
  /// Throws Error if the file cannot be written; write() does, too.
  explicit PoseFile(const std::filesystem::path& file);
  void write(const std::string& words, const std::vector<double>& numbers);

 private:
  std::filesystem::path file_;
  std::ofstream out_;
};

/// Pose graph in g2o's text format, written incrementally: one vertex per entry, one edge to the
/// preceding entry if both have poses, and one edge per registered loop.
class PoseGraphWriter {
 public:
  /// Throws Error if the file cannot be written; all member functions do.
  explicit PoseGraphWriter(const std::filesystem::path& file);
  /// `T_world_sensor`; absent: only loops constrain the vertex.
  void vertex(int64_t id, const std::optional<Eigen::Isometry3d>& T_world_sensor);
  /// Writes a vertex for an entry of an earlier session, once.
  void known_vertex(int64_t id, const std::optional<Eigen::Isometry3d>& T_world_sensor);
  /// `information` for (translation, rotation vector), as in Registration.
  void edge(int64_t from, int64_t to, const Eigen::Isometry3d& T_from_to,
            const Eigen::Matrix<double, 6, 6>& information);

 private:
  PoseFile file_;
  void write_vertex(int64_t id, const Eigen::Isometry3d& pose);

  std::optional<std::pair<int64_t, Eigen::Isometry3d>> last_;
  std::set<int64_t> written_;
};

/// Trajectory in the format of the TUM RGB-D benchmark: one line "time x y z qx qy qz qw" per pose.
class TrajectoryWriter {
 public:
  /// Throws Error if the file cannot be written; add() does, too.
  explicit TrajectoryWriter(const std::filesystem::path& file) : file_(file) {}
  /// `T_world_sensor`; `time` [s], or the frame number if times are unknown.
  void add(double time, const Eigen::Isometry3d& T_world_sensor);

 private:
  PoseFile file_;
};

}  // namespace revisit
