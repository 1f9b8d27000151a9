#include "revisit/registration/registration.h"

#include <nanobind/eigen/dense.h>
#include <nanobind/stl/optional.h>

#include <algorithm>

#include "listener.h"
#include "module.h"
#include "points.h"
#include "poses.h"
#include "record.h"
#include "revisit/recognition/optional_library.h"

namespace revisit::python {

using namespace nb::literals;
using namespace pipeline;

namespace {

bool has_pcl() {
  return std::ranges::find(optional_libraries(), "PCL", &OptionalLibrary::name)->built_in;
}

/// A view of what `self` holds, [n][3].
ReadOnlyFloats rows_of(const std::vector<Eigen::Vector3f>& (PreparedScan::*rows)() const,
                       nb::handle self) {
  const std::vector<Eigen::Vector3f>& held = (nb::cast<const PreparedScan&>(self).*rows)();
  return view_of(held.empty() ? nullptr : held[0].data(), {static_cast<int64_t>(held.size()), 3},
                 self);
}

/// Warns of an attribute's former name, which is kept for one release.
void warn_renamed(const char* former, const char* name) {
  if (PyErr_WarnFormat(PyExc_DeprecationWarning, 1, "%s is now %s", former, name) != 0)
    throw nb::python_error();
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
      .def_prop_ro(
          "fitness",
          [](const Registration& r) {
            warn_renamed("fitness", "mean_squared_distance");
            return r.mean_squared_distance;
          },
          "Former name of mean_squared_distance.")
      .def_prop_ro(
          "inliers",
          [](const Registration& r) {
            warn_renamed("inliers", "inlier_ratio");
            return r.inlier_ratio;
          },
          "Former name of inlier_ratio.")
      .def_ro("constraint", &Registration::constraint, "0 (along a corridor) to 1/3.")
      .def_ro("accepted", &Registration::accepted);
  module.attr("HAS_PCL") = has_pcl();
  module.def(
      "register_scans",
      [](const PreparedScan& query, const PreparedScan& place, double turn,
         const RegistrationOptions& options, const std::optional<nb::callable>& refine) {
        Unlocked unlocked;
        if (!refine) return register_scans(query, place, turn, options);
        return register_scans(query, place, turn, options, [&](const Eigen::Isometry3d& start) {
          const Locked lock(unlocked);
          return *pose_from(call(*refine, nb::cast(Matrix4d(start.matrix()))));
        });
      },
      "query"_a, "place"_a, "turn"_a, "options"_a = RegistrationOptions(), "refine"_a = nb::none(),
      "revisit.registration.register_scans(), by PCL, or by a function that takes T_place_query of "
      "the start, float64 [4][4], and returns where the scans fit best.");
}

}  // namespace revisit::python
