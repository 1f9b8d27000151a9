#pragma once

#include <nanobind/nanobind.h>

#include <array>
#include <optional>

#include "arrays.h"
#include "revisit/recognition/point_cloud.h"
#include "revisit/recognition/points.h"

/// Scans between C++ and numpy.
namespace revisit::python {

struct AnyPoints;
/// An argument for GivenPoints: what else is given there is refused by its message.
using PointsArgument = nb::typed<nb::handle, AnyPoints>;

/// The points of a scan as somebody gave them:
///   - float32 [n][3 or more], the columns being x, y, z;
///   - a structured array [n] with float32 fields x, y, z, as of a PointCloud2;
///   - three float32 arrays [n]: a tuple or list (x, y, z).
/// They are read where they are when a PointsView can say how; else they are copied once.
class GivenPoints {
 public:
  /// Throws nb::type_error for other types, nb::value_error for other shapes.
  explicit GivenPoints(nb::handle points);

  const pipeline::PointsView& view() const { return view_; }
  /// A copy for what needs a cloud of its own.
  pipeline::PointCloud cloud() const;
  /// The same; the fourth column of a plain array is intensity.
  pipeline::PointCloud cloud_with_intensity() const;

 private:
  void take_axes(nb::handle points);
  void take_columns(int64_t count, const std::array<int64_t, 3>& offsets);

  nb::object owner_;
  // Of an array: its first point, from one to the next and to the intensity [bytes].
  const char* base_ = nullptr;
  int64_t stride_ = 0;
  std::optional<int64_t> intensity_;
  pipeline::PointCloud copy_;
  pipeline::PointsView view_;
};

/// float32 [n][4]: x, y, z, intensity. It owns the cloud.
FloatArray array_of(pipeline::PointCloud cloud);

}  // namespace revisit::python

/// The name of the type in signatures of functions; there are no such objects.
template <>
struct nanobind::detail::type_caster<revisit::python::AnyPoints> {
  static constexpr auto Name = const_name(
      "numpy.typing.NDArray | tuple[numpy.typing.NDArray, numpy.typing.NDArray, "
      "numpy.typing.NDArray]");
};
