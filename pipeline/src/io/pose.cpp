#include "revisit/pipeline/pose.h"

#include <Eigen/LU>
#include <string_view>

#include "io/file_content.h"
#include "revisit/proto/error.h"

namespace revisit::pipeline {
namespace {

namespace fs = std::filesystem;

std::string place(const fs::path& file, size_t line_index) {
  return str(file.string(), ":", line_index + 1);
}

/// A row-major 3x4 [R | t].
Pose parse_pose(std::string_view text, const std::string& where) {
  const std::vector<double> values = parse_numbers(text, where);
  if (values.size() != 12)
    throw InputError(
        str(where, ": expected the 12 numbers of a row-major 3x4 matrix, found ", values.size()));
  using Matrix34 = Eigen::Matrix<double, 3, 4, Eigen::RowMajor>;
  const Eigen::Map<const Matrix34> matrix(values.data());
  const Eigen::Matrix3d R = matrix.leftCols<3>();
  constexpr double kTolerance = 1e-2;  // files hold 6 or 7 digits; a wrong layout is off by O(1)
  const double deviation = (R.transpose() * R - Eigen::Matrix3d::Identity()).cwiseAbs().maxCoeff();
  if (!(deviation <= kTolerance) || R.determinant() < 0)
    throw InputError(str(where, ": the first three columns are not a rotation (deviation ",
                         deviation, " from orthonormal, determinant ", R.determinant(),
                         "); expected a row-major 3x4 [R | t]"));
  Pose pose = Pose::Identity();
  pose.affine() = matrix;
  return pose;
}

}  // namespace

std::vector<Pose> read_kitti_poses(const fs::path& file) {
  const std::vector<std::string> lines = read_lines(file);
  if (lines.empty()) throw InputError(file.string() + ": empty file, it holds no poses");
  std::vector<Pose> poses;
  poses.reserve(lines.size());
  for (size_t i = 0; i < lines.size(); ++i) poses.push_back(parse_pose(lines[i], place(file, i)));
  return poses;
}

Pose read_kitti_calibration(const fs::path& file) {
  const std::vector<std::string> lines = read_lines(file);
  std::string keys;
  for (size_t i = 0; i < lines.size(); ++i) {
    const std::string_view line = lines[i];
    const size_t colon = line.find(':');
    if (colon == std::string_view::npos) continue;
    const std::string_view key = line.substr(0, colon);
    if (key == "Tr" || key == "Tr_velo_to_cam")  // the odometry and the object data set's name
      return parse_pose(line.substr(colon + 1), place(file, i));
    keys += str(keys.empty() ? "" : ", ", key.substr(0, 40));
  }
  throw InputError(str(file.string(), ": no line 'Tr:' (velodyne to camera); found ",
                       keys.empty() ? "no 'key:' lines" : keys));
}

std::vector<double> read_kitti_times(const fs::path& file) {
  const std::vector<std::string> lines = read_lines(file);
  if (lines.empty()) throw InputError(file.string() + ": empty file, it holds no times");
  std::vector<double> times;
  times.reserve(lines.size());
  for (size_t i = 0; i < lines.size(); ++i) {
    const std::vector<double> values = parse_numbers(lines[i], place(file, i));
    if (values.size() != 1)
      throw InputError(
          str(place(file, i), ": expected one time in seconds, found ", values.size(), " numbers"));
    times.push_back(values[0]);
  }
  return times;
}

}  // namespace revisit::pipeline
