#pragma once

#include <Eigen/Geometry>
#include <optional>
#include <vector>

#include "arrays.h"

/// Poses in numpy: float64 [4][4], row-major.
namespace revisit::python {

using Matrix4d = Eigen::Matrix<double, 4, 4, Eigen::RowMajor>;

inline std::optional<Matrix4d> matrix_of(const std::optional<Eigen::Isometry3d>& pose) {
  if (!pose) return std::nullopt;
  return Matrix4d(pose->matrix());
}

using PoseArgument = nb::typed<nb::handle, nb::ndarray<nb::numpy, double>>;

/// Returns nullopt for None. Throws TypeError unless given a float64 array, ValueError for another
/// shape or a matrix that is not a rigid transform.
std::optional<Eigen::Isometry3d> pose_from(nb::handle matrix);

/// [n][4][4]
nb::ndarray<nb::numpy, double> array_of_poses(const std::vector<Eigen::Isometry3d>& poses);

}  // namespace revisit::python
