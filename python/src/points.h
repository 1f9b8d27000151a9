#pragma once

#include <nanobind/nanobind.h>

#include <array>

#include "arrays.h"
#include "revisit/recognition/point_cloud.h"
#include "revisit/recognition/points.h"

/// Scans between C++ and numpy.
namespace revisit::python {

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

 private:
  void take_axes(nb::handle points);
  void take_columns(const char* base, int64_t count, int64_t stride,
                    const std::array<int64_t, 3>& offsets);

  nb::object owner_;
  pipeline::PointCloud copy_;
  pipeline::PointsView view_;
};

/// float32 [n][4]: x, y, z, intensity. It owns the cloud.
FloatArray array_of(pipeline::PointCloud cloud);

/// The fourth column of a plain array is intensity.
void copy_intensity(nb::handle points, pipeline::PointCloud& cloud);

/// The type of a scan, in signatures of functions.
#define REVISIT_POINTS                                                        \
  "numpy.typing.NDArray | tuple[numpy.typing.NDArray, numpy.typing.NDArray, " \
  "numpy.typing.NDArray]"

}  // namespace revisit::python
