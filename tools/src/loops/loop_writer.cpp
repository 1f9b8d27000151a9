#include "loop_writer.h"

#include <Eigen/Geometry>
#include <Eigen/LU>
#include <cerrno>
#include <cstring>
#include <numbers>
#include <ostream>

#include "cli/json.h"
#include "cli/options.h"
#include "cli/terminal.h"
#include "revisit/base/error.h"

namespace revisit::cli {
namespace {

constexpr int kDigits = 6;

std::string optional_number(bool there, double value, int digits) {
  return there ? number(value, digits) : "";
}

std::vector<std::string> cells_of(const reports::LoopLine& loop) {
  const reports::Registered& r = loop.registered();
  const auto optional_count = [](bool given, int64_t value) { return given ? str(value) : ""; };
  std::vector<std::string> cells = {
      str(loop.frame()),
      optional_number(loop.has_time(), loop.time(), kDigits),
      loop.match_drive(),
      optional_count(loop.has_match_frame(), loop.match_frame()),
      optional_number(loop.has_match_time(), loop.match_time(), kDigits),
      optional_number(loop.has_similarity(), loop.similarity(), kDigits),
      optional_number(loop.has_kth_similarity(), loop.kth_similarity(), kDigits),
      optional_number(loop.has_score(), loop.score(), kDigits),
      optional_number(loop.has_probability(), loop.probability(), kDigits),
      optional_number(loop.has_yaw_deg(), loop.yaw_deg(), 2),
      loop.has_accepted() ? str(loop.accepted() ? 1 : 0) : ""};
  const bool there = loop.has_registered();
  cells.push_back(there ? str(r.fits() ? 1 : 0) : "");
  for (const double value : {r.x(), r.y(), r.z(), r.qx(), r.qy(), r.qz(), r.qw(), r.inlier_ratio(),
                             r.mean_squared_distance()})
    cells.push_back(optional_number(there, value, kDigits));
  for (const auto& [given, at] : {std::pair(loop.has_position(), &loop.position()),
                                  std::pair(loop.has_match_position(), &loop.match_position())})
    for (const double value : {at->x(), at->y(), at->z()})
      cells.push_back(optional_number(given, value, 3));
  const std::string questioned = joined(loop.questioned(), " ");
  for (const std::string& text : {loop.drive(), loop.rejection(), questioned, loop.file()})
    cells.push_back(text);
  const reports::WorldPose& pose = loop.pose();
  for (const double value :
       {pose.x(), pose.y(), pose.z(), pose.qx(), pose.qy(), pose.qz(), pose.qw()})
    cells.push_back(optional_number(loop.has_pose(), value, kDigits));
  cells.push_back(joined(r.covariance(), " ", [](double value) { return str(value); }));
  return cells;
}

Table csv_table() {
  return Table(comma_separated(
      "frame,time,match_drive,match_frame,match_time,similarity,kth_similarity,score,probability,"
      "yaw_deg,accepted,registered,x,y,z,qx,qy,qz,qw,inlier_ratio,mean_squared_distance,here_x,"
      "here_y,here_z,match_x,match_y,match_z,drive,rejection,questioned,file,pose_x,pose_y,pose_z,"
      "pose_qx,pose_qy,pose_qz,pose_qw,covariance"));
}

void set_position(const Eigen::Vector3d& t, reports::Position& position) {
  position.set_x(t.x());
  position.set_y(t.y());
  position.set_z(t.z());
}

template <class Message>
void set_pose(const Eigen::Isometry3d& pose, Message& message) {
  const Eigen::Vector3d t = pose.translation();
  const Eigen::Quaterniond q(pose.rotation());
  message.set_x(t.x());
  message.set_y(t.y());
  message.set_z(t.z());
  message.set_qx(q.x());
  message.set_qy(q.y());
  message.set_qz(q.z());
  message.set_qw(q.w());
}

/// Nothing if a direction is free.
void set_covariance(const Eigen::Matrix<double, 6, 6>& information, reports::Registered& out) {
  const Eigen::FullPivLU<Eigen::Matrix<double, 6, 6>> lu(information);
  if (!lu.isInvertible()) return;
  const Eigen::Matrix<double, 6, 6> covariance = lu.inverse();
  for (int i = 0; i < covariance.rows(); ++i)
    for (int j = i; j < covariance.cols(); ++j) out.add_covariance(covariance(i, j));
}

}  // namespace

std::string json_of(const reports::LoopLine& loop) {
  std::string json = to_compact_json(loop);
  // Without the quotes that protobuf puts around 64-bit integers.
  const std::string name = "\"match_frame\":\"";  // within a text its quotes would be escaped
  if (const size_t at = json.find(name); at != std::string::npos) {
    const size_t quote = at + name.size() - 1;
    json.erase(json.find('"', quote + 1), 1);
    json.erase(quote, 1);
  }
  return json;
}

reports::LoopLine line_of(const Visit& visit, const std::string& drive) {
  reports::LoopLine line;
  if (!drive.empty()) line.set_drive(drive);
  line.set_frame(visit.scan.frame);
  line.set_file(visit.scan.file.string());
  if (visit.scan.pose) set_position(visit.scan.pose->translation(), *line.mutable_position());
  if (visit.scan.time) line.set_time(*visit.scan.time);
  if (!visit.found.loop) return line;
  const Loop& loop = *visit.found.loop;
  line.set_match_drive(loop.drive);
  line.set_match_frame(loop.frame);
  if (loop.pose) set_position(loop.pose->translation(), *line.mutable_match_position());
  if (loop.time) line.set_match_time(*loop.time);
  line.set_similarity(loop.similarity);
  line.set_kth_similarity(loop.kth_similarity);
  line.set_score(loop.score);
  if (loop.probability) line.set_probability(*loop.probability);
  if (loop.relative_yaw) line.set_yaw_deg(*loop.relative_yaw * 180 / std::numbers::pi);
  line.set_accepted(visit.found.accepted);
  if (const std::string& why = visit.found.rejection; !why.empty()) line.set_rejection(why);
  for (const int64_t frame : visit.found.questioned)
    line.add_questioned(static_cast<int32_t>(frame));
  if (!visit.found.registered) return line;
  const Registration& r = *visit.found.registered;
  reports::Registered& out = *line.mutable_registered();
  out.set_fits(r.fits);
  set_pose(r.T_place_query, out);
  set_covariance(r.information, out);
  if (visit.found.accepted && loop.pose)
    set_pose(*loop.pose * r.T_place_query, *line.mutable_pose());
  out.set_inlier_ratio(r.inlier_ratio);
  out.set_mean_squared_distance(r.mean_squared_distance);
  return line;
}

LoopWriter::LoopWriter(std::ostream& out, const std::string& format)
    : out_(out), json_(format == "jsonl") {
  errno = 0;
  if (!json_) csv_table().print_csv(out_);
  flush();
}

void LoopWriter::write(const reports::LoopLine& loop) {
  errno = 0;
  if (json_)
    out_ << json_of(loop) << "\n";
  else
    Table(cells_of(loop)).print_csv(out_);
  flush();
}

void LoopWriter::flush() {
  if (!out_.flush())
    throw Error("cannot write the loops: ", errno != 0 ? std::strerror(errno) : "write error");
}

}  // namespace revisit::cli
