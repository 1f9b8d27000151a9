#pragma once

#include <Eigen/Geometry>
#include <cstdint>
#include <filesystem>
#include <fstream>
#include <map>
#include <optional>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "revisit/loops/loop_detector.h"

namespace revisit::cli {

class LoopSummary {
 public:
  /// `threshold`: LoopDetector::threshold().
  LoopSummary(const Exclusion& exclusion, std::optional<double> threshold)
      : exclusion_(exclusion), threshold_(threshold) {}
  void add(const Detection& found);
  int64_t scans() const { return scans_; }
  int64_t skipped() const { return skipped_; }  ///< scans that could not be described
  const std::vector<int64_t>& questioned() const { return questioned_; }
  /// "332 scans, 172 loops accepted, 5 more look alike, but their points do not fit"
  std::string text() const;

 private:
  Exclusion exclusion_;
  std::optional<double> threshold_;
  int64_t scans_ = 0, skipped_ = 0, queried_ = 0, accepted_ = 0, few_entries_ = 0;
  std::map<std::string, int64_t> rejected_;
  std::vector<int64_t> questioned_;  // frames of loops that later ones call in question
  double best_ = 0;
};

/// A scan in the comments of a graph: "frame 170 time 17.5 drive town".
std::string scan_name(const std::string& drive, int64_t frame, const std::optional<double>& time);

/// Pose graph in g2o's text format, written incrementally: one vertex per entry, one edge to the
/// preceding entry if both have poses, and one edge per registered loop. A vertex ends with `scan`,
/// its scan_name(), as a comment.
class PoseGraphWriter {
 public:
  /// Throws Error if the file cannot be written; all member functions do.
  explicit PoseGraphWriter(const std::filesystem::path& file);
  /// `T_world_sensor`; absent: only loops constrain the vertex.
  void vertex(int64_t id, const std::optional<Eigen::Isometry3d>& T_world_sensor,
              const std::string& scan);
  /// Writes a vertex for an entry of an earlier session, once.
  void known_vertex(int64_t id, const std::optional<Eigen::Isometry3d>& T_world_sensor,
                    const std::string& scan);
  /// `information` for (translation, rotation vector), as in Registration.
  void edge(int64_t from, int64_t to, const Eigen::Isometry3d& T_from_to,
            const Eigen::Matrix<double, 6, 6>& information);

 private:
  void write_vertex(int64_t id, const Eigen::Isometry3d& pose, const std::string& scan);

  std::filesystem::path file_;
  std::ofstream out_;
  std::optional<std::pair<int64_t, Eigen::Isometry3d>> last_;
  std::set<int64_t> written_;
};

/// Trajectory in the format of the TUM RGB-D benchmark: one line "time x y z qx qy qz qw" per pose.
class TrajectoryWriter {
 public:
  /// Throws Error if the file cannot be written; add() does, too.
  explicit TrajectoryWriter(const std::filesystem::path& file);
  /// `T_world_sensor`; `time` [s], or the frame number if times are unknown.
  void add(double time, const Eigen::Isometry3d& T_world_sensor);

 private:
  std::filesystem::path file_;
  std::ofstream out_;
};

}  // namespace revisit::cli
