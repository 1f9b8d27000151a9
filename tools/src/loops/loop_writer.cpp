#include "loop_writer.h"

#include <cerrno>
#include <cstring>
#include <numbers>
#include <ostream>

#include "cli/json.h"
#include "cli/table.h"
#include "revisit/proto/error.h"
#include "revisit/proto/text.h"

namespace revisit::cli {
namespace {

constexpr int kDigits = 6;

std::string optional_number(bool there, double value, int digits) {
  return there ? number(value, digits) : "";
}

std::vector<std::string> cells_of(const reports::LoopLine& loop) {
  const reports::Registered& r = loop.registered();
  std::vector<std::string> cells = {
      str(loop.frame()),
      optional_number(loop.has_time(), loop.time(), kDigits),
      loop.match_drive(),
      str(loop.match_frame()),
      optional_number(loop.has_match_time(), loop.match_time(), kDigits),
      number(loop.similarity(), kDigits),
      number(loop.runner_up(), kDigits),
      number(loop.score(), kDigits),
      optional_number(loop.has_yaw_deg(), loop.yaw_deg(), 2),
      loop.has_accepted() ? str(loop.accepted() ? 1 : 0) : ""};
  const bool there = loop.has_registered();
  cells.push_back(there ? str(r.accepted() ? 1 : 0) : "");
  for (const double value :
       {r.x(), r.y(), r.z(), r.qx(), r.qy(), r.qz(), r.qw(), r.inliers(), r.fitness()})
    cells.push_back(optional_number(there, value, kDigits));
  return cells;
}

Table csv_table() {
  return Table({"frame",      "time",      "match_drive", "match_frame", "match_time",
                "similarity", "runner_up", "score",       "yaw_deg",     "accepted",
                "registered", "x",         "y",           "z",           "qx",
                "qy",         "qz",        "qw",          "inliers",     "fitness"});
}

}  // namespace

reports::LoopLine line_of(const Visit& visit) {
  reports::LoopLine line;
  line.set_frame(visit.scan.frame);
  if (visit.scan.time) line.set_time(*visit.scan.time);
  if (!visit.loop) return line;
  const pipeline::Loop& loop = *visit.loop;
  line.set_match_drive(loop.drive);
  line.set_match_frame(loop.frame);
  if (loop.time) line.set_match_time(*loop.time);
  line.set_similarity(loop.similarity);
  line.set_runner_up(loop.runner_up);
  line.set_score(loop.score);
  if (loop.turn) line.set_yaw_deg(*loop.turn * 180 / std::numbers::pi);
  line.set_accepted(loop.accepted);
  if (!visit.registered) return line;
  const pipeline::Registration& r = *visit.registered;
  const Eigen::Vector3d t = r.T_place_query.translation();
  const Eigen::Quaterniond q(r.T_place_query.rotation());
  reports::Registered& out = *line.mutable_registered();
  out.set_accepted(r.accepted);
  out.set_x(t.x());
  out.set_y(t.y());
  out.set_z(t.z());
  out.set_qx(q.x());
  out.set_qy(q.y());
  out.set_qz(q.z());
  out.set_qw(q.w());
  out.set_inliers(r.inliers);
  out.set_fitness(r.fitness);
  return line;
}

LoopWriter::LoopWriter(std::ostream& out, const std::string& format)
    : out_(out), json_(format == "jsonl") {
  if (!json_) csv_table().print_csv(out_);
  out_.flush();
}

void LoopWriter::write(const reports::LoopLine& loop) {
  if (json_)
    out_ << to_compact_json(loop) << "\n";
  else
    Table(cells_of(loop)).print_csv(out_);
  out_.flush();
  if (!out_) throw Error("cannot write the loops");
}

PoseGraphWriter::PoseGraphWriter(const std::filesystem::path& file) : file_(file), out_(file) {
  out_.precision(12);
  check();
}

void PoseGraphWriter::check() {
  out_.flush();
  if (!out_) throw Error(str(file_.string(), ": cannot be written: ", std::strerror(errno)));
}

void PoseGraphWriter::vertex(int64_t id, const std::optional<Eigen::Isometry3d>& T_world_sensor) {
  const Eigen::Isometry3d pose = T_world_sensor.value_or(Eigen::Isometry3d::Identity());
  const Eigen::Quaterniond q(pose.rotation());
  const Eigen::Vector3d t = pose.translation();
  out_ << "VERTEX_SE3:QUAT " << id << " " << t.x() << " " << t.y() << " " << t.z() << " " << q.x()
       << " " << q.y() << " " << q.z() << " " << q.w() << "\n";
  // Odometry is not told how good it is: 5 cm and 0.3 degrees between scans.
  if (last_ && T_world_sensor) {
    Eigen::Matrix<double, 6, 6> information = Eigen::Matrix<double, 6, 6>::Zero();
    information.diagonal() << Eigen::Vector3d::Constant(1 / (0.05 * 0.05)),
        Eigen::Vector3d::Constant(1 / (0.005 * 0.005));
    edge(last_->first, id, last_->second.inverse() * *T_world_sensor, information);
  }
  if (T_world_sensor)
    last_.emplace(id, *T_world_sensor);
  else
    last_.reset();
  check();
}

void PoseGraphWriter::edge(int64_t from, int64_t to, const Eigen::Isometry3d& T_from_to,
                           const Eigen::Matrix<double, 6, 6>& information) {
  const Eigen::Quaterniond q(T_from_to.rotation());
  const Eigen::Vector3d t = T_from_to.translation();
  out_ << "EDGE_SE3:QUAT " << from << " " << to << " " << t.x() << " " << t.y() << " " << t.z()
       << " " << q.x() << " " << q.y() << " " << q.z() << " " << q.w();
  // g2o's rotation is the quaternion's vector, half of the rotation vector.
  for (int i = 0; i < 6; ++i)
    for (int j = i; j < 6; ++j)
      out_ << " " << information(i, j) * (i < 3 ? 1 : 2) * (j < 3 ? 1 : 2);
  out_ << "\n";
  check();
}

}  // namespace revisit::cli
