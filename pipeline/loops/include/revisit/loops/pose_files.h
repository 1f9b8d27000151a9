#pragma once

#include <Eigen/Geometry>
#include <filesystem>
#include <fstream>
#include <optional>
#include <set>
#include <string>
#include <vector>

namespace revisit::pipeline {

/// Lines of numbers, each on its way to the disk when it is written.
class PoseFile {
 public:
  /// Throws Error when the file cannot be written; so does write().
  explicit PoseFile(const std::filesystem::path& file);
  /// `words`, then numbers.
  void write(const std::string& words, const std::vector<double>& numbers);

 private:
  std::filesystem::path file_;
  std::ofstream out_;
};

/// A pose graph in g2o's text format, written as it grows: a vertex a place, an edge to the one
/// before it where both have poses, and an edge a registered loop.
class PoseGraphWriter {
 public:
  /// Throws Error when the file cannot be written; so do the others.
  explicit PoseGraphWriter(const std::filesystem::path& file);
  /// `T_world_sensor`; absent: only loops tell where it is.
  void vertex(int64_t id, const std::optional<Eigen::Isometry3d>& T_world_sensor);
  /// A vertex for a place of an earlier session, unless it is written already.
  void known_vertex(int64_t id, const std::optional<Eigen::Isometry3d>& T_world_sensor);
  /// `information` of translation and rotation vector, as Registration has it.
  void edge(int64_t from, int64_t to, const Eigen::Isometry3d& T_from_to,
            const Eigen::Matrix<double, 6, 6>& information);

 private:
  PoseFile file_;
  void write_vertex(int64_t id, const Eigen::Isometry3d& pose);

  std::optional<std::pair<int64_t, Eigen::Isometry3d>> last_;
  std::set<int64_t> written_;
};

/// A trajectory in the format of the TUM RGB-D benchmark: "time x y z qx qy qz qw" a line.
class TrajectoryWriter {
 public:
  /// Throws Error when the file cannot be written; so does add().
  explicit TrajectoryWriter(const std::filesystem::path& file) : file_(file) {}
  /// `T_world_sensor`; `time` [s], or the number of the frame where there are no times.
  void add(double time, const Eigen::Isometry3d& T_world_sensor);

 private:
  PoseFile file_;
};

}  // namespace revisit::pipeline
