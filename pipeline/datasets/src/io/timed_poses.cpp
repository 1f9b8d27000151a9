#include "revisit/datasets/timed_poses.h"

#include <algorithm>
#include <cmath>
#include <iterator>

#include "io/file_content.h"
#include "io/rigid_pose.h"
#include "revisit/base/error.h"
#include "revisit/base/text.h"

namespace revisit::pipeline {
namespace {

namespace fs = std::filesystem;

constexpr const char* kRowOfFormat[] = {"12 numbers: the rows of a 3 x 4 matrix",
                                        "time x y z qx qy qz qw",
                                        "time [ns], x, y, z, qw, qx, qy, qz"};

struct NumberedLine {
  std::string text, where;
  bool has_commas = false;  // they are blanks in `text`
};

/// Lines with numbers, without comments.
std::vector<NumberedLine> lines_of_numbers(const fs::path& file) {
  const std::vector<std::string> lines = read_lines(file);
  std::vector<NumberedLine> rows;
  for (size_t i = 0; i < lines.size(); ++i) {
    std::string text = lines[i].substr(0, lines[i].find('#'));
    const bool has_commas = text.find(',') != std::string::npos;
    std::ranges::replace(text, ',', ' ');
    if (text.find_first_not_of(" \t") == std::string::npos) continue;
    rows.push_back({std::move(text), str(file.string(), ":", i + 1), has_commas});
  }
  if (rows.empty()) throw InputError(file.string(), ": is empty");
  return rows;
}

/// EuRoC's times are whole nanoseconds, and speeds may follow the pose.
PoseFormat format_of(const fs::path& file, const NumberedLine& first) {
  std::string_view rest = first.text;
  const std::string_view time = take_word(&rest);
  int64_t words = 1;
  while (!take_word(&rest).empty()) ++words;
  const bool nanoseconds = (first.has_commas || time.size() > 12) &&
                           time.find_first_not_of("0123456789") == std::string_view::npos;
  if (words >= 8 && words != 12 && nanoseconds) return PoseFormat::kEuroc;
  if (words == 12) return PoseFormat::kKitti;
  if (words == 8) return PoseFormat::kTum;
  throw InputError(file.string(), ": no poses in a known format (kitti: ", kRowOfFormat[0],
                   "; tum: ", kRowOfFormat[1], "; euroc: ", kRowOfFormat[2],
                   "); the first line is '", first.text.substr(0, 60), "'");
}

Pose pose_of(const Eigen::Vector3d& t, const Eigen::Quaterniond& q) {
  Pose pose(q.normalized());
  pose.translation() = t;
  return pose;
}

/// A time [s] with as many digits as say it to the millisecond.
std::string milliseconds(double seconds) {
  return exact(std::round(seconds * 1000) / 1000);
}

}  // namespace

TimedPoses read_timed_poses(const fs::path& file, std::optional<PoseFormat> given) {
  const std::vector<NumberedLine> lines = lines_of_numbers(file);
  const PoseFormat format = given ? *given : format_of(file, lines[0]);
  TimedPoses timed{file.string(), {}, {}};
  if (format == PoseFormat::kKitti) {
    for (const NumberedLine& line : lines)
      timed.poses.push_back(rigid_pose(parse_numbers(line.text, line.where), line.where));
    return timed;
  }
  const bool euroc = format == PoseFormat::kEuroc;
  const char* const columns = kRowOfFormat[static_cast<size_t>(format)];
  std::vector<std::pair<double, Pose>> rows;
  for (const auto& [text, where, has_commas] : lines) {
    const std::vector<double> v = parse_numbers(text, where);
    if (v.size() < 8 || (!euroc && v.size() > 8))
      throw InputError(where, ": expected ", columns, ", found ", v.size(), " columns");
    const Eigen::Quaterniond q = euroc ? Eigen::Quaterniond(v[4], v[5], v[6], v[7])
                                       : Eigen::Quaterniond(v[7], v[4], v[5], v[6]);
    if (!(std::abs(q.norm() - 1) <= 0.01))
      throw InputError(where, ": expected ", columns,
                       " with quaternions of length 1, found one of length ", q.norm());
    rows.emplace_back(v[0] * (euroc ? 1e-9 : 1), pose_of({v[1], v[2], v[3]}, q));
  }
  std::ranges::stable_sort(rows, {}, &std::pair<double, Pose>::first);
  for (auto& [time, pose] : rows) {
    timed.times.push_back(time);
    timed.poses.push_back(pose);
  }
  return timed;
}

Pose read_extrinsic(const fs::path& file) {
  const std::string content = "\n" + read_content(file);
  for (const char* const entry : {"\nTr:", "\nTr_velo_to_cam:"})
    if (content.find(entry) != std::string::npos) return read_kitti_calibration(file);
  std::string numbers;
  for (const NumberedLine& line : lines_of_numbers(file)) numbers += line.text + " ";
  std::vector<double> rows = parse_numbers(numbers, file.string());
  if (rows.size() != 12 && rows.size() != 16)
    throw InputError(file.string(), ": expected a calib.txt with Tr, or 3 x 4 or 4 x 4 numbers, ",
                     "found ", rows.size());
  rows.resize(12);
  return rigid_pose(rows, file.string());
}

std::vector<Pose> poses_of(const TimedPoses& timed, std::span<const ScanRef> scans,
                           double max_gap) {
  const std::vector<double>& times = timed.times;
  const auto n_poses = std::ssize(timed.poses);
  std::vector<Pose> poses;
  int64_t lost = 0;
  double worst = 0;
  int worst_frame = 0;
  for (const ScanRef& scan : scans) {
    if (times.empty()) {
      if (scan.frame >= n_poses)
        throw InputError(timed.file, ": holds ", n_poses, " poses (frames 0 to ", n_poses - 1,
                         "), but the last scan is frame ", scans.back().frame);
      poses.push_back(timed.poses[static_cast<size_t>(scan.frame)]);
      continue;
    }
    if (!scan.time)
      throw InputError(timed.file,
                       ": its poses belong to times, and the scans have none; "
                       "give poses in KITTI's form");
    auto at = std::ranges::lower_bound(times, *scan.time);
    if (at == times.end() || (at != times.begin() && *scan.time - *(at - 1) <= *at - *scan.time))
      --at;
    const double gap = std::abs(*at - *scan.time);
    lost += gap <= max_gap ? 0 : 1;
    if (gap > worst) worst = gap, worst_frame = scan.frame;
    poses.push_back(timed.poses[static_cast<size_t>(at - times.begin())]);
  }
  if (lost == 0) return poses;
  const auto [first, last] = std::ranges::minmax(scans, {}, &ScanRef::time);
  throw InputError(timed.file, ": ", lost, " of ", scans.size(), " scans have no pose within ",
                   max_gap, " s; frame ", worst_frame, " is ", milliseconds(worst),
                   " s off. The scans are from ", milliseconds(*first.time), " to ",
                   milliseconds(*last.time), " s, the poses from ", milliseconds(times.front()),
                   " to ", milliseconds(times.back()), " s");
}

Pose axes_of_camera() {
  Pose T_camera_lidar = Pose::Identity();
  T_camera_lidar.linear() << 0, -1, 0,  //
      0, 0, -1,                         //
      1, 0, 0;
  return T_camera_lidar;
}

Pose in_kitti_world(const Pose& pose, PoseFrame frame, const std::optional<Pose>& T_body_lidar) {
  if (frame == PoseFrame::kCamera) return pose * T_body_lidar.value_or(axes_of_camera());
  return axes_of_camera() * pose * T_body_lidar.value_or(Pose::Identity());
}

Pose in_frame(const Pose& T_world_lidar, PoseFrame frame) {
  return frame == PoseFrame::kCamera ? T_world_lidar : axes_of_camera().inverse() * T_world_lidar;
}

}  // namespace revisit::pipeline
