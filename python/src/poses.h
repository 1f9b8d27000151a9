#pragma once

#include <Eigen/Geometry>
#include <optional>
#include <vector>

#include "arrays.h"

/// Poses between C++ and numpy: float64 [4][4], row-major as numpy's.
namespace revisit::python {

using Matrix4d = Eigen::Matrix<double, 4, 4, Eigen::RowMajor>;

inline std::optional<Matrix4d> matrix_of(const std::optional<Eigen::Isometry3d>& pose) {
  if (!pose) return std::nullopt;
  return Matrix4d(pose->matrix());
}

/// An argument for pose_from().
using PoseArgument = nb::typed<nb::handle, nb::ndarray<nb::numpy, double>>;

/// Throws nb::type_error for anything but a float64 array, nb::value_error for another shape and
/// for anything but a rigid motion. None: there is no pose.
std::optional<Eigen::Isometry3d> pose_from(nb::handle matrix);

/// [n][4][4]
nb::ndarray<nb::numpy, double> array_of_poses(const std::vector<Eigen::Isometry3d>& poses);

}  // namespace revisit::python
