#include "revisit/registration/registration.h"

#include <nanobind/eigen/dense.h>

#include "listener.h"
#include "module.h"
#include "points.h"
#include "poses.h"
#include "record.h"

namespace revisit::python {
/// A PreparedScan, or points as GivenPoints takes them.
struct AnyScan;
}  // namespace revisit::python

/// The name of the type in signatures of functions; there are no such objects.
template <>
struct nanobind::detail::type_caster<revisit::python::AnyScan> {
  static constexpr auto Name =
      const_name("PreparedScan | ") + type_caster<revisit::python::AnyPoints>::Name;
};

namespace revisit::python {

using namespace nb::literals;
using namespace pipeline;

namespace {

using ScanArgument = nb::typed<nb::handle, AnyScan>;

PreparedScan prepared(nb::handle scan, const RegistrationOptions& options) {
  PreparedScan* given = nullptr;
  if (nb::try_cast(scan, given) && given) return *given;
  const PointCloud cloud = GivenPoints(scan).cloud();
  return without_lock([&] { return PreparedScan(cloud, options); });
}

/// A view of what `self` holds, [n][3].
ReadOnlyFloats rows_of(const std::vector<Eigen::Vector3f>& (PreparedScan::*rows)() const,
                       nb::handle self) {
  const std::vector<Eigen::Vector3f>& held = (nb::cast<const PreparedScan&>(self).*rows)();
  return view_of(held.empty() ? nullptr : held[0].data(), {static_cast<int64_t>(held.size()), 3},
                 self);
}

/// Reads an attribute by its former name, which is kept for one release.
auto former(const char* before, const char* name, double Registration::*value) {
  return [=](const Registration& registration) {
    if (PyErr_WarnFormat(PyExc_DeprecationWarning, 1, "%s is now %s", before, name) != 0)
      throw nb::python_error();
    return registration.*value;
  };
}

}  // namespace

void bind_registration(nb::module_& module) {
  const auto checked_later = [](const RegistrationOptions&) {};
  bind_record<RegistrationOptions>(
      module, "RegistrationOptions", "All but shares in [m].", checked_later,
      Field{"voxel", &RegistrationOptions::voxel},
      Field{"max_range", &RegistrationOptions::max_range},
      Field{"reach", &RegistrationOptions::reach},
      Field{"max_distance", &RegistrationOptions::max_distance},
      Field{"inlier_distance", &RegistrationOptions::inlier_distance},
      Field{"least_inliers", &RegistrationOptions::least_inliers},
      Field{"least_constraint", &RegistrationOptions::least_constraint});
  nb::class_<PreparedScan>(
      module, "PreparedScan",
      "A scan thinned, with its search tree and normals: as query and as place.",
      nb::is_weak_referenceable())
      .def(
          "__init__",
          [](PreparedScan* self, PointsArgument points, const RegistrationOptions& options) {
            const PointCloud cloud = GivenPoints(points).cloud();
            without_lock([&] { new (self) PreparedScan(cloud, options); });
          },
          "points"_a, "options"_a = RegistrationOptions())
      .def("__len__", &PreparedScan::size)
      .def_prop_ro(
          "points", [](nb::handle self) { return rows_of(&PreparedScan::points, self); },
          "In the sensor's frame, float32 [n][3] [m], read-only.")
      .def_prop_ro(
          "normals", [](nb::handle self) { return rows_of(&PreparedScan::normals, self); },
          "float32 [n][3], of either sign; none of a scan of fewer than 100 points.");
  nb::class_<Registration>(module, "Registration", "How a query lies to a place.")
      .def_prop_ro(
          "T_place_query", [](const Registration& r) { return Matrix4d(r.T_place_query.matrix()); },
          "Takes points of the query's frame to the place's, float64 [4][4] [m].")
      .def_prop_ro(
          "information", [](const Registration& r) { return r.information; },
          "Inverse covariance of (t, w), float64 [6][6], in the query's frame.")
      .def_ro("mean_squared_distance", &Registration::mean_squared_distance,
              "Of the inliers [m^2].")
      .def_ro("inlier_ratio", &Registration::inlier_ratio,
              "Share of the query's upright points, 0 to 1.")
      .def_prop_ro("fitness",
                   former("fitness", "mean_squared_distance", &Registration::mean_squared_distance),
                   "Former name of mean_squared_distance.")
      .def_prop_ro("inliers", former("inliers", "inlier_ratio", &Registration::inlier_ratio),
                   "Former name of inlier_ratio.")
      .def_ro("constraint", &Registration::constraint, "0 (along a corridor) to 1/3.")
      .def_ro("accepted", &Registration::accepted);
  module.def(
      "register_scans",
      [](ScanArgument query, ScanArgument place, double turn, const RegistrationOptions& options) {
        const PreparedScan a = prepared(query, options), b = prepared(place, options);
        return without_lock([&] { return register_scans(a, b, turn, options); });
      },
      "query"_a, "place"_a, "turn"_a, "options"_a = RegistrationOptions(),
      "Registers a query with a place: each a PreparedScan, or points as it takes them.\n\n"
      "turn: heading of the query less that of the place, counter-clockwise [rad], as Loop.turn.\n"
      "First the shift within `options.reach`, and the turn within 3 degrees, under which upright\n"
      "points meet best, seen from above; from there generalized ICP. Raises UsageError for "
      "invalid\n"
      "options or a turn that is not finite.");
}

}  // namespace revisit::python
