#include "revisit/registration/registration.h"

#include <nanobind/eigen/dense.h>

#include "module.h"
#include "points.h"
#include "unlocked.h"

namespace revisit::python {
struct AnyScan;
}  // namespace revisit::python

template <>
struct nanobind::detail::type_caster<revisit::python::AnyScan> {
  static constexpr auto Name =
      const_name("PreparedScan | ") + type_caster<revisit::python::AnyPoints>::Name;
};

namespace revisit::python {

using namespace nb::literals;

namespace {

using ScanArgument = nb::typed<nb::handle, AnyScan>;

PreparedScan prepared(nb::handle scan, const RegistrationOptions& options) {
  PreparedScan* given = nullptr;
  if (nb::try_cast(scan, given) && given) return *given;
  const PointCloud cloud = GivenPoints(scan).cloud();
  return without_lock([&] { return PreparedScan(cloud, options); });
}

/// View [n][3] of rows that `self` owns.
ReadOnlyFloats rows_of(const std::vector<Eigen::Vector3f>& (PreparedScan::*rows)() const,
                       nb::handle self) {
  const std::vector<Eigen::Vector3f>& held = (nb::cast<const PreparedScan&>(self).*rows)();
  return view_of(held.empty() ? nullptr : held[0].data(), {static_cast<int64_t>(held.size()), 3},
                 self);
}

}  // namespace

void bind_registration(nb::module_& module) {
  const auto checked_later = [](const RegistrationOptions&) {};
  bind_record<RegistrationOptions>(
      module, "RegistrationOptions", "Settings of register_scans().", checked_later,
      Field{"voxel_size", &RegistrationOptions::voxel_size, "Edge of the voxels, 0.05 to 5 [m]."},
      Field{"max_range", &RegistrationOptions::max_range,
            "Farther points are ignored; at most 200 [m]."},
      Field{"search_radius", &RegistrationOptions::search_radius,
            "Of the initial shift along x and y, 0 to 20 [m]."},
      Field{"max_distance", &RegistrationOptions::max_distance,
            "Maximum distance of corresponding points [m]."},
      Field{"inlier_distance", &RegistrationOptions::inlier_distance,
            "Maximum distance of an inlier [m]."},
      Field{"min_inlier_ratio", &RegistrationOptions::min_inlier_ratio,
            "Minimum Registration.inlier_ratio that fits."},
      Field{"min_constraint", &RegistrationOptions::min_constraint,
            "Minimum Registration.constraint that fits."});
  nb::class_<PreparedScan>(
      module, "PreparedScan",
      "A downsampled scan with its search tree and normals, for use as query or place.",
      nb::is_weak_referenceable())
      .def(
          "__init__",
          [](PreparedScan* self, PointsArgument points, const RegistrationOptions& options) {
            const PointCloud cloud = GivenPoints(points).cloud();
            without_lock([&] { new (self) PreparedScan(cloud, options); });
          },
          "points"_a, "options"_a = RegistrationOptions(),
          "points: float [n][3 or more] in the sensor's frame [m], or (x, y, z). Raises UsageError "
          "for invalid options.")
      .def("__len__", [](const PreparedScan& scan) { return scan.points().size(); })
      .def_prop_ro(
          "points", [](nb::handle self) { return rows_of(&PreparedScan::points, self); },
          "Points in the sensor's frame, float32 [n][3] [m], read-only.")
      .def_prop_ro(
          "normals", [](nb::handle self) { return rows_of(&PreparedScan::normals, self); },
          "Normals of arbitrary sign, float32 [n][3]; empty for a scan of fewer than 100 points.");
  nb::class_<Registration>(module, "Registration", "Relative pose of a query to a place.")
      .def_prop_ro(
          "T_place_query", [](const Registration& r) { return Matrix4d(r.T_place_query.matrix()); },
          "Transforms points from the query's frame to the place's, float64 [4][4] [m].")
      .def_prop_ro(
          "information", [](const Registration& r) { return r.information; },
          "Inverse covariance of (t, w), float64 [6][6], in the query's frame: t [m], w [rad].")
      .def_ro("mean_squared_distance", &Registration::mean_squared_distance,
              "Mean squared distance of the inliers [m^2].")
      .def_ro("inlier_ratio", &Registration::inlier_ratio,
              "Fraction of the query's non-ground points that are inliers, 0 to 1.")
      .def_ro("constraint", &Registration::constraint,
              "Degeneracy measure, from 0 (unconstrained, e.g. along a corridor) to 1/3.")
      .def_ro("fits", &Registration::fits,
              "Enough of the query's points are inliers, and the pose is constrained.");
  module.def(
      "register_scans",
      [](ScanArgument query, ScanArgument place, double relative_yaw,
         const RegistrationOptions& options) {
        const PreparedScan a = prepared(query, options), b = prepared(place, options);
        return without_lock([&] { return register_scans(a, b, relative_yaw, options); });
      },
      "query"_a, "place"_a, "relative_yaw"_a, "options"_a = RegistrationOptions(),
      "Registers a query with a place: each a PreparedScan or the points of a scan.\n\n"
      "relative_yaw: initial yaw(query) - yaw(place), counter-clockwise [rad], e.g. "
      "Loop.relative_yaw.\n"
      "The initial translation, within `options.search_radius`, and yaw, within 3 degrees, are "
      "those with the best top-down overlap of non-ground points. Generalized ICP refines them.\n"
      "Raises UsageError for invalid options or a relative_yaw that is not finite.");
}

}  // namespace revisit::python
