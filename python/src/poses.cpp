#include "poses.h"

#include "revisit/base/error.h"
#include "strings.h"

namespace revisit::python {

std::optional<Eigen::Isometry3d> pose_from(nb::handle matrix) {
  if (matrix.is_none()) return std::nullopt;
  refuse_masked(matrix, "pose");
  GivenArray<double> array;
  if (!nb::ndarray_check(matrix) || !nb::try_cast(matrix, array, false))
    throw type_error(
        str("pose: expected a numpy array of float64 [4][4], found ", description_of(matrix)));
  if (shape_of(array) != std::vector<int64_t>{4, 4})
    throw value_error(
        str("pose: expected an array of shape (4, 4), found ", description_of(matrix)));
  Eigen::Isometry3d pose;
  for (int row = 0; row < 4; ++row)
    for (int column = 0; column < 4; ++column)
      pose.matrix()(row, column) = array.data()[row * array.stride(0) + column * array.stride(1)];
  const Eigen::Matrix3d R = pose.linear();
  constexpr double kTolerance = 1e-3;  // rounding in files with few digits
  if (!pose.matrix().allFinite() || !R.isUnitary(kTolerance) || R.determinant() < 0 ||
      pose.matrix().row(3) != Eigen::RowVector4d(0, 0, 0, 1))
    throw value_error(
        "pose: expected a rigid transform T_world_sensor (rotation, translation [m], last row "
        "0 0 0 1)");
  return pose;
}

nb::ndarray<nb::numpy, double> array_of_poses(const std::vector<Eigen::Isometry3d>& poses) {
  std::vector<double> values;
  for (const Eigen::Isometry3d& pose : poses) {
    const Eigen::Matrix<double, 4, 4, Eigen::RowMajor> rows = pose.matrix();
    values.insert(values.end(), rows.data(), rows.data() + rows.size());
  }
  return array_of(std::move(values), {static_cast<int64_t>(poses.size()), 4, 4});
}

}  // namespace revisit::python
