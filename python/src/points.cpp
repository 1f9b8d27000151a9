#include "points.h"

#include <array>
#include <cstring>
#include <tuple>
#include <utility>

#include "module.h"
#include "revisit/base/error.h"

namespace revisit::python {
namespace {

[[noreturn]] void refuse_type(nb::handle found) {
  throw type_error(
      str("points: expected a numpy array of float32 or float64 [n][3 or 4], a structured array "
          "with such fields x, y, z of one type, or a tuple of three such arrays, found ",
          description_of(found),
          "; arrays are not converted implicitly: use numpy.asarray(x, numpy.float32)"));
}

bool is_number(nb::handle dtype) {
  return is_float32(dtype) || is_float64(dtype);
}

/// Type of x, y, z, and their offsets [bytes] from the start of a point.
std::pair<nb::object, std::array<int64_t, 3>> fields_of(nb::handle points) {
  std::array<int64_t, 3> offsets{};
  nb::object type;
  const nb::object fields = points.attr("dtype").attr("fields");
  for (size_t axis = 0; axis < 3; ++axis) {
    const nb::object field = fields.attr("get")(std::string(1, "xyz"[axis]));
    if (field.is_none() || (axis > 0 && !type.equal(field[0]))) refuse_type(points);
    type = field[0];
    offsets[axis] = nb::cast<int64_t>(field[1]);
  }
  return {type, offsets};
}

}  // namespace

GivenPoints::GivenPoints(nb::handle points) : owner_(nb::borrow(points)) {
  if (nb::isinstance<nb::tuple>(points) || nb::isinstance<nb::list>(points)) {
    take_axes(points);
    return;
  }
  // Classes have `shape` and the other attributes, too; objects may have only the interface.
  if (nb::isinstance<nb::type_object>(points)) refuse_type(points);
  for (const char* name : {"__array_interface__", "shape", "strides", "dtype"})
    if (!nb::hasattr(points, name)) refuse_type(points);
  refuse_masked(points, "points");
  const nb::tuple shape = points.attr("shape"), strides = points.attr("strides");
  nb::object type = points.attr("dtype");
  const bool structured = !type.attr("names").is_none();
  std::array<int64_t, 3> offsets{};
  if (structured) std::tie(type, offsets) = fields_of(points);
  if (!is_number(type)) refuse_type(points);
  is_double_ = is_float64(type);
  if (structured && shape.size() != 1)
    throw value_error(
        str("points: expected a structured array of one axis, found ", description_of(points)));
  if (!structured) {
    check_shape(points, shape);
    const auto column = nb::cast<int64_t>(strides[1]);
    offsets = {0, column, 2 * column};
    if (nb::cast<int64_t>(shape[1]) > 3) intensity_ = 3 * column;
  }
  const nb::object interface = points.attr("__array_interface__");
  const nb::object address = interface["data"][0];
  base_ = static_cast<const char*>(PyLong_AsVoidPtr(address.ptr()));
  stride_ = nb::cast<int64_t>(strides[0]);
  take_columns(nb::cast<int64_t>(shape[0]), offsets);
}

void GivenPoints::check_shape(nb::handle points, const nb::tuple& shape) const {
  constexpr int64_t kMostColumns = 16;  // of a point; more are points of x, y, z in rows
  const bool is_table = shape.size() == 2;
  const auto rows = is_table ? nb::cast<int64_t>(shape[0]) : 0;
  const auto columns = is_table ? nb::cast<int64_t>(shape[1]) : 0;
  const bool is_turned = (rows == 3 || rows == 4) && columns > kMostColumns;
  if (columns < 3 || is_turned)
    throw value_error(str("points: expected an array of shape (n, 3) or (n, 4), found ",
                          description_of(points),
                          is_turned ? ", which has a column for each point; use x.T" : ""));
}

void GivenPoints::take_axes(nb::handle points) {
  if (nb::len(points) != 3) refuse_type(points);
  std::array<std::vector<float>, 3> axes;
  for (size_t axis = 0; axis < 3; ++axis)
    axes[axis] = numbers_of(points[axis], str("points, ", "xyz"[axis]));
  if (axes[1].size() != axes[0].size() || axes[2].size() != axes[0].size())
    throw value_error(str("points: expected three arrays of one length, found ",
                          description_of(points[0]), ", ", description_of(points[1]), ", ",
                          description_of(points[2])));
  copy_.points.resize(axes[0].size());
  for (size_t i = 0; i < copy_.points.size(); ++i)
    copy_.points[i] = {axes[0][i], axes[1][i], axes[2][i]};
  view_ = view_of(copy_);
}

float GivenPoints::number_at(const char* address) const {
  const auto read = [&](auto value) {
    std::memcpy(&value, address, sizeof value);  // may be unaligned
    return static_cast<float>(value);
  };
  return is_double_ ? read(double{}) : read(float{});
}

void GivenPoints::take_columns(int64_t count, const std::array<int64_t, 3>& offsets) {
  const auto bytes = static_cast<int64_t>(is_double_ ? sizeof(double) : sizeof(float));
  bool fits = true;  // the coordinates lie within a stride
  for (const int64_t offset : offsets) fits = fits && offset >= 0 && offset + bytes <= stride_;
  if (fits || count == 0) {
    view_ = {base_, static_cast<size_t>(count)};
    if (fits)
      view_ = {base_,
               static_cast<size_t>(count),
               static_cast<size_t>(stride_),
               static_cast<size_t>(offsets[0]),
               static_cast<size_t>(offsets[1]),
               static_cast<size_t>(offsets[2]),
               is_double_};
    return;
  }
  copy_.points.resize(static_cast<size_t>(count));
  for (int64_t i = 0; i < count; ++i) {
    const char* from = base_ + i * stride_;
    copy_.points[static_cast<size_t>(i)] = {
        number_at(from + offsets[0]), number_at(from + offsets[1]), number_at(from + offsets[2])};
  }
  view_ = view_of(copy_);
}

PointCloud GivenPoints::cloud() const {
  PointCloud cloud;
  copy_points(view_, cloud);
  return cloud;
}

PointCloud GivenPoints::cloud_with_intensity() const {
  PointCloud with = cloud();
  if (!intensity_) return with;
  const char* from = base_ + *intensity_;
  for (Point& point : with.points) {
    point.intensity = number_at(from);
    from += stride_;
  }
  return with;
}

FloatArray array_of(PointCloud cloud) {
  auto* kept = new PointCloud(std::move(cloud));
  const nb::capsule owner(kept, [](void* p) noexcept { delete static_cast<PointCloud*>(p); });
  return view_of(kept->points.empty() ? nullptr : &kept->points.front().x,
                 {static_cast<int64_t>(kept->points.size()), 4}, owner);
}

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
