#include <nanobind/eigen/dense.h>
#include <nanobind/stl/filesystem.h>
#include <nanobind/stl/optional.h>
#include <nanobind/stl/pair.h>
#include <nanobind/stl/vector.h>

#include "arrays.h"
#include "module.h"
#include "points.h"
#include "revisit/recognition/align.h"
#include "revisit/recognition/feature.h"
#include "revisit/recognition/matrix.h"
#include "revisit/recognition/range_image.h"
#include "revisit/recognition/ring/model.h"
#include "unlocked.h"

namespace revisit::python {
namespace {

using namespace nb::literals;

FloatArray array_of_image(RangeImage image) {
  const std::vector<int64_t> shape = {image.height, image.width};
  return array_of(std::move(image.pixels), shape);
}

void bind_images(nb::module_& module) {
  bind_record<ImageGeometry>(
      module, "ImageGeometry", "Geometry of a range image, the same for all scans of a sensor.",
      check_geometry, Field{"width", &ImageGeometry::width, "Columns, over 360 degrees."},
      Field{"height", &ImageGeometry::height, "Rows."},
      Field{"elevation_top", &ImageGeometry::elevation_top, "Upper edge [deg]."},
      Field{"elevation_bottom", &ImageGeometry::elevation_bottom, "Lower edge [deg]."},
      Field{"max_range", &ImageGeometry::max_range, "Range of pixel value 255 [m]."},
      Field{"closing_width", &ImageGeometry::closing_width,
            "Width of holes that are closed [deg]; 0: none."},
      Field{"closing_height", &ImageGeometry::closing_height,
            "Height of holes that are closed [deg]."});
  module.def(
      "project",
      [](PointsArgument points, const ImageGeometry& geometry) {
        const PointCloud cloud = GivenPoints(points).cloud();
        return array_of_image(without_lock([&] { return project(cloud, geometry); }));
      },
      "points"_a, "geometry"_a = ImageGeometry(),
      "Projects a scan without alignment to a range image [height][width]: 0 (no return) to 255 "
      "(max_range or farther). Column 0 looks backwards; azimuth decreases with the column. "
      "float32.");
  module.def(
      "scan_to_image",
      [](PointsArgument points, const std::string& align, const ImageGeometry& geometry) {
        const PointCloud cloud = GivenPoints(points).cloud();
        const AlignCase mode = parse_align_case(align);
        return array_of_image(without_lock([&] { return scan_to_image(cloud, mode, geometry); }));
      },
      "points"_a, "align"_a = "none", "geometry"_a = ImageGeometry(),
      "Returns the input image of features: the scan is aligned ('none', 'case1' or 'case2') and "
      "projected, then holes are closed. Raises InputError if it cannot be aligned.");
}

void bind_sensors(nb::module_& module) {
  nb::class_<Sensor>(module, "Sensor", "A LiDAR sensor and the image geometry for its scans.")
      .def_ro("name", &Sensor::name, "Name for sensor_geometry().")
      .def_ro("model", &Sensor::model, "Maker and model.")
      .def_ro("beams", &Sensor::beams, "Number of beams; 0 for a non-repetitive scan pattern.")
      .def_ro("top", &Sensor::top, "Elevation of the highest beam [deg].")
      .def_ro("bottom", &Sensor::bottom, "Elevation of the lowest beam [deg].")
      .def_ro("image", &Sensor::image, "Image geometry for its scans.")
      .def("__repr__", [](const Sensor& sensor) {
        return str("<Sensor '", sensor.name, "': ", sensor.model, ">");
      });
  module.def("sensors", &sensors, "Lists the known sensors.");
  module.def("sensor_geometry", &sensor_geometry, "sensor"_a,
             "Returns the image geometry of a sensor. Raises UsageError with the closest name for "
             "an unknown one.");
  module.def(
      "choose_ring_model",
      [](const nb::typed<nb::list, PointsArgument>& scans, const std::string& feature_key) {
        std::vector<PointCloud> clouds;
        for (const nb::handle scan : scans) clouds.push_back(GivenPoints(scan).cloud());
        return without_lock([&] { return choose_ring_model(clouds, feature_key); });
      },
      "scans"_a, "feature_key"_a = "",
      "Returns the sensor of shipped_ring_models() whose model suits these scans best, and the "
      "reason. `feature_key`: feature_key_of() an existing map, whose model is preferred. Raises "
      "UsageError without points.");
  module.def(
      "parse_mount", [](const std::string& mount) { return Matrix4d(parse_mount(mount).matrix()); },
      "mount"_a,
      "Parses 'roll,pitch,yaw,x,y,z' [deg, m]: rotations about x, y, z, then the translation. "
      "Returns float64 [4][4]. Raises UsageError.");
}

void bind_alignment(nb::module_& module) {
  nb::class_<Alignment>(module, "Alignment",
                        "Rotation that aligns a scan with its principal directions.")
      .def_prop_ro(
          "R_aligned_sensor", [](const Alignment& a) { return a.R_aligned_sensor; },
          "Rows: aligned axes x', y', z' in the sensor's frame.")
      .def_prop_ro(
          "eigenvalues", [](const Alignment& a) { return a.eigenvalues; }, "[m^2]")
      .def_ro("eigenvalue_ratio", &Alignment::eigenvalue_ratio,
              "If near 1, the direction is undetermined.")
      .def_ro("abs_t11", &Alignment::abs_t11, "If near 0, the direction may flip.")
      .def_ro("yaw", &Alignment::yaw, "Yaw of x' in the sensor's frame [rad], counter-clockwise.");
  module.def(
      "principal_alignment",
      [](PointsArgument points, const std::string& align) {
        const PointCloud cloud = GivenPoints(points).cloud();
        const AlignCase mode = parse_align_case(align);
        return without_lock([&] { return principal_alignment(cloud, mode); });
      },
      "points"_a, "align"_a = "case1",
      "Computes the principal directions of a scan. Raises InputError for fewer than 3 usable "
      "points.");
}

}  // namespace

void bind_recognition(nb::module_& module) {
  bind_images(module);
  bind_sensors(module);
  bind_alignment(module);
  bind_features(module);
  bind_pca(module);
  module.def(
      "cosine",
      [](GivenFloats a, GivenFloats b) {
        const auto x = contiguous_floats(a, "a"), y = contiguous_floats(b, "b");
        if (x.ndim() != 1 || y.ndim() != 1 || x.shape(0) != y.shape(0))
          throw value_error(str("cosine: expected two vectors of one length, found ",
                                description_of(a), ", ", description_of(b)));
        const std::span<const float> u(x.data(), x.size()), v(y.data(), y.size());
        return cosine(u, length_of(u), v, length_of(v));
      },
      "a"_a, "b"_a,
      "Cosine similarity of two float32 vectors, in double precision; 0 if one of them is zero.");
}

}  // namespace revisit::python
