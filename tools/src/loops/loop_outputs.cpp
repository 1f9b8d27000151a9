#include "loop_outputs.h"

#include <algorithm>
#include <cerrno>
#include <cmath>
#include <cstring>
#include <iterator>
#include <vector>

#include "cli/terminal.h"
#include "pose_graph.h"
#include "revisit/base/error.h"
#include "revisit/base/text.h"

namespace revisit::cli {
namespace {

void flush(std::ofstream& out, const std::filesystem::path& file) {
  out.flush();
  if (!out) throw Error(file.string(), ": cannot be written: ", std::strerror(errno));
}

std::ofstream open_text(const std::filesystem::path& file) {
  std::ofstream out(file);
  out.precision(15);
  flush(out, file);
  return out;
}

void write_line(std::ofstream& out, const std::filesystem::path& file, const std::string& words,
                const std::vector<double>& numbers, const std::string& end = "") {
  out << words;
  const char* between = words.empty() ? "" : " ";
  for (const double number : numbers) {
    out << between << number;
    between = " ";
  }
  out << end << "\n";
  flush(out, file);
}

}  // namespace

std::string scan_name(const std::string& drive, int64_t frame, const std::optional<double>& time) {
  std::string name =
      str("frame ", frame, time ? " time " + number(*time, 6) : "", " drive ", drive);
  std::ranges::replace(name, '\n', ' ');
  return name;
}

void LoopSummary::add(const Detection& found) {
  ++scans_;
  skipped_ += found.error.empty() ? 0 : 1;
  if (!found.loop) return;
  best_ = queried_++ == 0 ? found.loop->score : std::max(best_, found.loop->score);
  accepted_ += found.accepted ? 1 : 0;
  const bool by_score = threshold_ && found.loop->score >= *threshold_;
  few_entries_ += found.rejection == "score" && by_score ? 1 : 0;
  ++rejected_[found.rejection];
  std::ranges::copy(found.questioned, std::back_inserter(questioned_));
}

std::string LoopSummary::text() const {
  const auto rounded = [](double score) { return exact(std::round(score * 1000) / 1000); };
  std::string text = str(plural(scans_, "scan"), ", ", plural(accepted_, "loop"), " accepted");
  if (accepted_ == 0 && queried_ == 0)
    text += str(": no scan had a candidate (exclusion ", to_string(exclusion_), ")");
  else if (accepted_ == 0 && threshold_)
    text += str(": the best score of ", queried_, queried_ == 1 ? " query" : " queries", " is ",
                rounded(best_), " (threshold ", rounded(*threshold_), "); ",
                plural(scans_ - skipped_ - queried_, "scan"), " had no candidate (exclusion ",
                to_string(exclusion_), ")");
  const auto rejected = [&](const char* why) {
    const auto found = rejected_.find(why);
    return found == rejected_.end() ? 0 : found->second;
  };
  for (const auto& [n, why] :
       {std::pair(few_entries_, "among too few distinct entries"),
        std::pair(rejected("similarity"), "but not enough to be registered"),
        std::pair(rejected("ambiguous"), "where the drive looks alike for long"),
        std::pair(rejected("registration"), "but their points do not fit"),
        std::pair(rejected("contradicted"), "but points of one float in free space of the other"),
        std::pair(rejected("hidden"), "but something near hides the scene"),
        std::pair(rejected("odometry"), "but not by the drive's motion"),
        std::pair(rejected("inconsistent"), "but other loops contradict them"),
        std::pair(rejected("no points"), "but their entries have no readable points")})
    if (n > 0) text += str(", ", n, " more look alike, ", why);
  if (!questioned_.empty())
    text += str(", ", plural(std::ssize(questioned_), "loop"), " contradicted by later ones");
  return skipped_ > 0 ? str(text, ", ", plural(skipped_, "scan"), " skipped") : text;
}

PoseGraphWriter::PoseGraphWriter(const std::filesystem::path& file)
    : file_(file), out_(open_text(file)) {}

void PoseGraphWriter::vertex(int64_t id, const std::optional<Eigen::Isometry3d>& T_world_sensor,
                             const std::string& scan) {
  write_vertex(id, T_world_sensor.value_or(Eigen::Isometry3d::Identity()), scan);
  if (last_ && T_world_sensor) {
    const Eigen::Isometry3d step = last_->second.inverse() * *T_world_sensor;
    edge(last_->first, id, step, odometry_information(step));
  }
  if (T_world_sensor)
    last_.emplace(id, *T_world_sensor);
  else
    last_.reset();
}

void PoseGraphWriter::known_vertex(int64_t id,
                                   const std::optional<Eigen::Isometry3d>& T_world_sensor,
                                   const std::string& scan) {
  if (!written_.contains(id))
    write_vertex(id, T_world_sensor.value_or(Eigen::Isometry3d::Identity()), scan);
}

void PoseGraphWriter::write_vertex(int64_t id, const Eigen::Isometry3d& pose,
                                   const std::string& scan) {
  const Eigen::Quaterniond q(pose.rotation());
  const Eigen::Vector3d t = pose.translation();
  write_line(out_, file_, str("VERTEX_SE3:QUAT ", id),
             {t.x(), t.y(), t.z(), q.x(), q.y(), q.z(), q.w()}, "  # " + scan);
  written_.insert(id);
}

void PoseGraphWriter::edge(int64_t from, int64_t to, const Eigen::Isometry3d& T_from_to,
                           const Eigen::Matrix<double, 6, 6>& information) {
  const Eigen::Quaterniond q(T_from_to.rotation());
  const Eigen::Vector3d t = T_from_to.translation();
  // g2o's rotation is the vector part of the quaternion, half of the rotation vector.
  std::vector<double> numbers = {t.x(), t.y(), t.z(), q.x(), q.y(), q.z(), q.w()};
  for (int i = 0; i < 6; ++i)
    for (int j = i; j < 6; ++j)
      numbers.push_back(information(i, j) * (i < 3 ? 1 : 2) * (j < 3 ? 1 : 2));
  write_line(out_, file_, str("EDGE_SE3:QUAT ", from, " ", to), numbers);
}

TrajectoryWriter::TrajectoryWriter(const std::filesystem::path& file)
    : file_(file), out_(open_text(file)) {}

void TrajectoryWriter::add(double time, const Eigen::Isometry3d& T_world_sensor) {
  const Eigen::Quaterniond q(T_world_sensor.rotation());
  const Eigen::Vector3d t = T_world_sensor.translation();
  write_line(out_, file_, "", {time, t.x(), t.y(), t.z(), q.x(), q.y(), q.z(), q.w()});
}

}  // namespace revisit::cli
