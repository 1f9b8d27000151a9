#pragma once

#include <reports.pb.h>

#include <Eigen/Geometry>
#include <fstream>
#include <optional>
#include <string>

#include "loops/recognise.h"

namespace revisit::cli {

/// What is printed of a scan.
reports::LoopLine line_of(const Visit& visit);

/// Prints loops as they are found, a line each, at once: "csv" with a header, or "jsonl".
class LoopWriter {
 public:
  LoopWriter(std::ostream& out, const std::string& format);
  void write(const reports::LoopLine& loop);

 private:
  std::ostream& out_;
  bool json_;
};

/// A pose graph in g2o's text format, written as it grows: a vertex a place, an edge to the one
/// before it where both have poses, and an edge a registered loop.
class PoseGraphWriter {
 public:
  /// Throws Error when the file cannot be written; so do the others.
  explicit PoseGraphWriter(const std::filesystem::path& file);
  /// `T_world_sensor`; absent: only loops tell where it is.
  void vertex(int64_t id, const std::optional<Eigen::Isometry3d>& T_world_sensor);
  /// `information` of translation and rotation vector, as Registration has it.
  void edge(int64_t from, int64_t to, const Eigen::Isometry3d& T_from_to,
            const Eigen::Matrix<double, 6, 6>& information);

 private:
  void check();
  std::filesystem::path file_;
  std::ofstream out_;
  std::optional<std::pair<int64_t, Eigen::Isometry3d>> last_;
};

}  // namespace revisit::cli
