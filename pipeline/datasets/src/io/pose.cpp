#include "revisit/datasets/pose.h"

#include <Eigen/LU>
#include <algorithm>
#include <string_view>

#include "io/file_content.h"
#include "io/rigid_pose.h"
#include "revisit/base/error.h"

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

}  // namespace

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

std::vector<Pose> read_kitti_poses(const fs::path& file) {
  const std::vector<std::string> lines = read_lines(file);
  if (lines.empty()) throw InputError(file.string() + ": empty file, it holds no poses");
  std::vector<Pose> poses;
  poses.reserve(lines.size());
  for (size_t i = 0; i < lines.size(); ++i) {
    const std::string where = place(file, i);
    poses.push_back(rigid_pose(parse_numbers(lines[i], where), where));
  }
  return poses;
}

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

std::vector<double> read_kitti_times(const fs::path& file) {
  const std::vector<std::string> lines = read_lines(file);
  if (lines.empty()) throw InputError(file.string() + ": empty file, it holds no times");
  std::vector<double> times;
  times.reserve(lines.size());
  for (size_t i = 0; i < lines.size(); ++i) {
    const std::vector<double> values = parse_numbers(lines[i], place(file, i));
    if (values.size() != 1)
      throw InputError(place(file, i), ": expected one time in seconds, found ", values.size(),
                       " numbers");
    times.push_back(values[0]);
  }
  return times;
}

}  // namespace revisit
