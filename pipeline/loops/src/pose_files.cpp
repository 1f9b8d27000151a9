#include "revisit/loops/pose_files.h"

#include <cerrno>
#include <cstring>

#include "revisit/base/error.h"

namespace revisit {

PoseFile::PoseFile(const std::filesystem::path& file) : file_(file), out_(file) {
  out_.precision(15);
  write("", {});
}

void PoseFile::write(const std::string& words, const std::vector<double>& numbers) {
  out_ << words;
  const char* between = words.empty() ? "" : " ";
  for (const double number : numbers) {
    out_ << between << number;
    between = " ";
  }
  if (!numbers.empty()) out_ << "\n";
  out_.flush();
  if (!out_) throw Error(file_.string(), ": cannot be written: ", std::strerror(errno));
}

PoseGraphWriter::PoseGraphWriter(const std::filesystem::path& file) : file_(file) {}

void PoseGraphWriter::vertex(int64_t id, const std::optional<Eigen::Isometry3d>& T_world_sensor) {
  write_vertex(id, T_world_sensor.value_or(Eigen::Isometry3d::Identity()));
  // Assumed odometry noise, because none is given: 5 cm and 0.3 degrees between scans.
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
}

void PoseGraphWriter::known_vertex(int64_t id,
                                   const std::optional<Eigen::Isometry3d>& T_world_sensor) {
  if (!written_.contains(id))
    write_vertex(id, T_world_sensor.value_or(Eigen::Isometry3d::Identity()));
}

void PoseGraphWriter::write_vertex(int64_t id, const Eigen::Isometry3d& pose) {
  const Eigen::Quaterniond q(pose.rotation());
  const Eigen::Vector3d t = pose.translation();
  file_.write(str("VERTEX_SE3:QUAT ", id), {t.x(), t.y(), t.z(), q.x(), q.y(), q.z(), q.w()});
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
  file_.write(str("EDGE_SE3:QUAT ", from, " ", to), numbers);
}

void TrajectoryWriter::add(double time, const Eigen::Isometry3d& T_world_sensor) {
  const Eigen::Quaterniond q(T_world_sensor.rotation());
  const Eigen::Vector3d t = T_world_sensor.translation();
  file_.write("", {time, t.x(), t.y(), t.z(), q.x(), q.y(), q.z(), q.w()});
}

}  // namespace revisit
