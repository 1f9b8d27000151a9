#include <Eigen/LU>
#include <algorithm>
#include <charconv>
#include <cmath>
#include <iterator>
#include <span>
#include <string>

#include "io/file_content.h"
#include "revisit/base/error.h"
#include "revisit/base/text.h"
#include "revisit/datasets/dataset.h"

namespace revisit {
namespace {

namespace fs = std::filesystem;

std::string place(const fs::path& file, size_t line_index) {
  return str(file.string(), ":", line_index + 1);
}

using Matrix34 = Eigen::Matrix<double, 3, 4>;

Matrix34 matrix_of(std::span<const double> numbers, const std::string& where) {
  if (numbers.size() != 12)
    throw InputError(where, ": expected the 12 numbers of a row-major 3x4 matrix, found ",
                     numbers.size());
  return Eigen::Map<const Eigen::Matrix<double, 3, 4, Eigen::RowMajor>>(numbers.data());
}

/// Row-major 3x4 [R | t]. Throws InputError for a wrong count and if R is not a rotation.
Pose rigid_pose(std::span<const double> numbers, const std::string& where) {
  const Matrix34 matrix = matrix_of(numbers, where);
  const Eigen::Matrix3d R = matrix.leftCols<3>();
  constexpr double kTolerance = 1e-2;  // files have 6 or 7 digits; a wrong layout deviates by O(1)
  const double deviation = (R.transpose() * R - Eigen::Matrix3d::Identity()).cwiseAbs().maxCoeff();
  if (!(deviation <= kTolerance) || R.determinant() < 0)
    throw InputError(where, ": the first three columns are not a rotation (deviation ", deviation,
                     " from orthonormal, determinant ", R.determinant(),
                     "); expected a row-major 3x4 [R | t]");
  Pose pose = Pose::Identity();
  pose.affine() = matrix;
  return pose;
}

struct Entry {
  std::string values, where;
};

Entry find_entry(const fs::path& file, const std::vector<std::string>& keys, const char* meaning) {
  const std::vector<std::string> lines = read_lines(file);
  std::string found;
  for (size_t i = 0; i < lines.size(); ++i) {
    const size_t colon = lines[i].find(':');
    if (colon == std::string::npos) continue;
    const std::string key = lines[i].substr(0, colon);
    if (std::find(keys.begin(), keys.end(), key) != keys.end())
      return {lines[i].substr(colon + 1), place(file, i)};
    found += str(found.empty() ? "" : ", ", key.substr(0, 40));
  }
  throw InputError(file.string(), ": no line '", keys[0], ":' (", meaning, "); found ",
                   found.empty() ? "no 'key:' lines" : found);
}

constexpr const char* kRowOfFormat[] = {"12 numbers: the rows of a 3 x 4 matrix",
                                        "time x y z qx qy qz qw",
                                        "time [ns], x, y, z, qw, qx, qy, qz"};

constexpr const char* kOtherLines =
    "; begin a header with #, and remove lines without a pose (not of KITTI's format)";

struct Row {
  std::vector<double> numbers;
  std::string where;
  size_t line;
  bool has_commas;
};

std::vector<Row> rows_of(const fs::path& file) {
  const std::vector<std::string> lines = read_lines(file);
  std::vector<Row> rows;
  for (size_t i = 0; i < lines.size(); ++i) {
    std::string text = lines[i].substr(0, lines[i].find('#'));
    const bool has_commas = text.find(',') != std::string::npos;
    std::ranges::replace(text, ',', ' ');
    if (text.find_first_not_of(" \t") == std::string::npos) continue;
    const std::string where = str(file.string(), ":", i + 1);
    try {
      rows.push_back({parse_numbers(text, where), where, i, has_commas});
    } catch (const InputError& error) {
      throw InputError(error.what(), kOtherLines);
    }
  }
  if (rows.empty()) throw InputError(file.string(), ": is empty");
  return rows;
}

/// Times that span more than 11 days, or are beyond 33,000 years, are nanoseconds.
bool in_nanoseconds(const std::vector<Row>& rows) {
  const double first = rows.front().numbers[0], last = rows.back().numbers[0];
  return std::abs(last) > 1e12 || std::abs(last - first) > 1e6;
}

/// Velocities may follow the pose in EuRoC's format.
std::string format_of(const fs::path& file, const std::vector<Row>& rows) {
  const size_t count = rows[0].numbers.size();
  if (rows[0].has_commas && count >= 8 && in_nanoseconds(rows)) return "euroc";
  if (count == 12) return "kitti";
  if (count == 8) return "tum";
  throw InputError(file.string(), ": no poses in a known format (kitti: ", kRowOfFormat[0],
                   "; tum: ", kRowOfFormat[1], "; euroc: ", kRowOfFormat[2],
                   "); the first line has ", count, " numbers; write the columns of one format");
}

/// Reads a file whose line number is the frame.
template <class Value, class Read>
std::vector<Value> values_of_frames(const std::vector<Row>& rows, const char* what,
                                    const Read& read) {
  std::vector<Value> values;
  for (const Row& row : rows) {
    if (row.line != rows[0].line + values.size())
      throw InputError(row.where, ": expected the ", what, " of frame ", values.size(),
                       " on the line before");
    values.push_back(read(row));
  }
  return values;
}

std::vector<Pose> kitti_poses(const std::vector<Row>& rows) {
  return values_of_frames<Pose>(rows, "pose",
                                [](const Row& row) { return rigid_pose(row.numbers, row.where); });
}

Pose pose_of(const Eigen::Vector3d& t, const Eigen::Quaterniond& q) {
  Pose pose(q.normalized());
  pose.translation() = t;
  return pose;
}

std::string milliseconds(double seconds) {
  char text[400];  // also of the largest number
  const double rounded = std::round(seconds * 1000) / 1000;
  return {text, std::to_chars(text, std::end(text), rounded, std::chars_format::fixed).ptr};
}

}  // namespace

Pose read_kitti_calibration(const fs::path& file) {
  // Keys of the odometry and of the object data set.
  const Entry entry = find_entry(file, {"Tr", "Tr_velo_to_cam"}, "velodyne to camera");
  return rigid_pose(parse_numbers(entry.values, entry.where), entry.where);
}

Matrix34 read_kitti_projection(const fs::path& file, const std::string& name) {
  const Entry entry = find_entry(file, {name}, "projection of a camera");
  const Matrix34 P = matrix_of(parse_numbers(entry.values, entry.where), entry.where);
  const bool is_camera = P.allFinite() && P(0, 0) > 0 && P(1, 1) > 0 && P(1, 0) == 0 &&
                         P(2, 0) == 0 && P(2, 1) == 0 && P(2, 2) == 1;
  if (!is_camera)
    throw InputError(entry.where,
                     ": expected a projection [fx s cx a; 0 fy cy b; 0 0 1 c] with fx, fy > 0");
  return P;
}

std::vector<Pose> read_kitti_poses(const fs::path& file) {
  return kitti_poses(rows_of(file));
}

std::vector<double> read_kitti_times(const fs::path& file) {
  return values_of_frames<double>(rows_of(file), "time", [](const Row& row) {
    if (row.numbers.size() != 1)
      throw InputError(row.where, ": expected one time in seconds, found ", row.numbers.size(),
                       " numbers");
    return row.numbers[0];
  });
}

TimedPoses read_timed_poses(const fs::path& file, const std::string& given) {
  const std::vector<Row> rows = rows_of(file);
  const std::string format = given.empty() ? format_of(file, rows) : given;
  if (format == "kitti") return {file.string(), {}, kitti_poses(rows)};
  const bool euroc = format == "euroc";
  if (!euroc && format != "tum")
    throw UsageError("format of poses: expected kitti, tum or euroc, found '", format, "'");
  const char* const columns = kRowOfFormat[euroc ? 2 : 1];
  const double seconds = euroc || in_nanoseconds(rows) ? 1e-9 : 1;
  std::vector<std::pair<double, Pose>> timed_poses;
  for (const auto& [v, where, line, has_commas] : rows) {
    if (v.size() < 8 || (!euroc && v.size() > 8))
      throw InputError(where, ": expected ", columns, ", found ", v.size(), " columns");
    const Eigen::Quaterniond q = euroc ? Eigen::Quaterniond(v[4], v[5], v[6], v[7])
                                       : Eigen::Quaterniond(v[7], v[4], v[5], v[6]);
    if (!(std::abs(q.norm() - 1) <= 0.01))
      throw InputError(where, ": expected ", columns,
                       " with quaternions of length 1, found one of length ", q.norm());
    timed_poses.emplace_back(v[0] * seconds, pose_of({v[1], v[2], v[3]}, q));
  }
  std::ranges::stable_sort(timed_poses, {}, &std::pair<double, Pose>::first);
  TimedPoses timed{file.string(), {}, {}};
  for (auto& [time, pose] : timed_poses) {
    timed.times.push_back(time);
    timed.poses.push_back(pose);
  }
  return timed;
}

Pose read_extrinsic(const fs::path& file) {
  const std::string content = "\n" + read_content(file);
  for (const char* const entry : {"\nTr:", "\nTr_velo_to_cam:"})
    if (content.find(entry) != std::string::npos) return read_kitti_calibration(file);
  std::vector<double> numbers;
  for (const Row& row : rows_of(file)) std::ranges::copy(row.numbers, std::back_inserter(numbers));
  if (numbers.size() != 12 && numbers.size() != 16)
    throw InputError(file.string(), ": expected a calib.txt with Tr, or 3 x 4 or 4 x 4 numbers, ",
                     "found ", numbers.size());
  numbers.resize(12);
  return rigid_pose(numbers, file.string());
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
                       ": its poses have times, but the scans have none; "
                       "provide poses in KITTI's format");
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

}  // namespace revisit
