#pragma once

#include <nanobind/nanobind.h>

#include <Eigen/Geometry>
#include <array>
#include <optional>
#include <vector>

#include "arrays.h"
#include "revisit/recognition/point_cloud.h"

namespace revisit::python {

struct AnyPoints;
/// Argument type for GivenPoints, which reports all type errors itself.
using PointsArgument = nb::typed<nb::handle, AnyPoints>;

/// Points of a scan given by a caller:
///   - float32 or float64 [n][3 or more], the columns being x, y, z;
///   - a structured array [n] with such fields x, y, z of one type, e.g. of a PointCloud2;
///   - three such arrays [n]: a tuple or list (x, y, z).
/// Points are copied only if a PointsView cannot express their layout.
class GivenPoints {
 public:
  /// Throws nb::type_error for other types, nb::value_error for other shapes.
  explicit GivenPoints(nb::handle points);

  const PointsView& view() const { return view_; }
  PointCloud cloud() const;
  /// Intensities are the fourth column of an unstructured array.
  PointCloud cloud_with_intensity() const;

 private:
  void take_axes(nb::handle points);
  void take_columns(int64_t count, const std::array<int64_t, 3>& offsets);
  void check_shape(nb::handle points, const nb::tuple& shape) const;
  float number_at(const char* address) const;

  nb::object owner_;
  // First point of an array; offsets to the next point and to the intensity [bytes].
  const char* base_ = nullptr;
  int64_t stride_ = 0;
  bool is_double_ = false;
  std::optional<int64_t> intensity_;
  PointCloud copy_;
  PointsView view_;
};

/// float32 [n][4]: x, y, z, intensity. The array owns the cloud.
FloatArray array_of(PointCloud cloud);

// Poses in numpy: float64 [4][4], row-major.

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

/// Type name in Python signatures; no object has this type.
template <>
struct nanobind::detail::type_caster<revisit::python::AnyPoints> {
  static constexpr auto Name = const_name(
      "numpy.typing.NDArray | tuple[numpy.typing.NDArray, numpy.typing.NDArray, "
      "numpy.typing.NDArray]");
};
