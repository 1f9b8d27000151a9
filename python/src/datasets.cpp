#include <nanobind/eigen/dense.h>
#include <nanobind/stl/filesystem.h>
#include <nanobind/stl/optional.h>
#include <nanobind/stl/pair.h>
#include <nanobind/stl/tuple.h>
#include <nanobind/stl/vector.h>

#include <filesystem>

#include "arrays.h"
#include "module.h"
#include "points.h"
#include "revisit/datasets/dataset.h"
#include "revisit/datasets/perturbation.h"
#include "revisit/datasets/scan_file.h"
#include "unlocked.h"

namespace revisit::python {

namespace fs = std::filesystem;
using namespace nb::literals;

void bind_datasets(nb::module_& module) {
  nb::class_<ScanRef>(module, "ScanRef", "One scan of a data set; read_scan(file) reads it.")
      .def_ro("file", &ScanRef::file, "File of the scan.")
      .def_ro("frame", &ScanRef::frame,
              "Frame in the sequence; KITTI: the number in the file's name.")
      .def_prop_ro(
          "pose", [](const ScanRef& scan) { return matrix_of(scan.pose); },
          "T_world_sensor, for KITTI T_world_cam, float64 [4][4] [m]; None without poses.")
      .def_ro("time", &ScanRef::time, "[s], or None.")
      .def_ro("place", &ScanRef::place,
              "Name of the place in a data set sorted by places; else ''.")
      .def("__repr__", [](const ScanRef& scan) {
        return str("<ScanRef ", scan.frame, " '", scan.file.string(), "'>");
      });
  nb::class_<Dataset>(module, "Dataset", "A sequence or folder of scans, in frame order.")
      .def_ro("name", &Dataset::name, "Name, from the folder.")
      .def_ro("sequence", &Dataset::sequence, "Sequence, e.g. '00'; '' for a plain folder.")
      .def_ro("scans", &Dataset::scans, nb::rv_policy::copy, "Scans in frame order.")
      .def_ro("n_poses", &Dataset::n_poses,
              "Poses, also of frames without a scan; 0 without poses.")
      .def_ro("warnings", &Dataset::warnings, "What was skipped or missing.")
      .def_prop_ro("has_poses", &Dataset::has_poses, "Every scan has a pose.")
      .def_prop_ro("has_places", &Dataset::has_places, "Scans are sorted by places.");
  module.def(
      "open_dataset", open_dataset, nb::call_guard<Unlocked>(), "root"_a, "sequence"_a = "",
      nb::kw_only(), "poses"_a = false,
      "Opens a KITTI odometry sequence, a folder with one folder per place, or a folder of .bin, "
      ".pcd or .ply files.\n\n"
      "poses: require poses. Raises InputError with the files that were expected.");
  module.def(
      "read_scan",
      [](const fs::path& file) { return array_of(without_lock([&] { return read_scan(file); })); },
      "file"_a,
      "Reads a scan (.bin, .pcd or .ply): float32 [n][4], x forward, y left, z up [m], intensity. "
      "Raises InputError with the file.");
  module.def(
      "perturb",
      [](PointsArgument points, uint64_t seed, const std::optional<std::string>& perturbation) {
        PointCloud cloud = GivenPoints(points).cloud_with_intensity();
        const Perturbation steps =
            perturbation ? parse_perturbation(*perturbation) : random_augmentation(seed);
        without_lock([&] { perturb(cloud, steps, seed); });
        return array_of(cloud);
      },
      "points"_a, "seed"_a, "perturbation"_a = nb::none(),
      "Perturbs a scan as if another robot had taken it: float32 [n][4].\n\n"
      "perturbation: comma-separated steps as of `revisit eval --perturb`; None: random "
      "steps, as in training with augmentation. Raises UsageError for an invalid step.");
  module.def(
      "read_recorded_scan",
      [](const fs::path& file) {
        PointCloud cloud;
        RecordedTimes times = without_lock([&] { return read_recorded_scan(file, cloud); });
        return std::tuple(
            array_of(std::move(cloud)), times.field,
            times.field.empty() ? std::nullopt : std::optional(array_of(std::move(times.values))));
      },
      "file"_a,
      "Reads a scan, float32 [n][4], and its times of points as recorded: the field's name and "
      "float64 [n]; '' and None if the file has none. See point_times(). Raises InputError.");
  using Values = nb::ndarray<const double, nb::ndim<1>, nb::c_contig, nb::device::cpu>;
  const auto span_of = [](const Values& values) {
    return std::span<const double>(values.data(), values.shape(0));
  };
  module.attr("POINT_TIME_NAMES") =
      nb::cast(std::vector<std::string>(std::begin(kPointTimeNames), std::end(kPointTimeNames)));
  nb::class_<PointTimes>(module, "PointTimes",
                         "Convention of per-point times, the same for all scans of a recording.")
      .def(
          "__init__",
          [=](PointTimes* self,
              const std::vector<
                  std::tuple<std::string, std::optional<Values>, std::optional<double>>>& scans,
              const std::string& unit, std::optional<double> period) {
            std::vector<RecordedTimes> recorded;
            for (const auto& [field, values, stamp] : scans) {
              recorded.push_back({.field = field, .stamp = stamp});
              if (!values) continue;
              const std::span<const double> given = span_of(*values);
              recorded.back().values.assign(given.begin(), given.end());
            }
            new (self) PointTimes(point_times_of(recorded, unit, period));
          },
          "scans"_a, "unit"_a = "auto", "period"_a = nb::none(),
          "Decides from some scans in order: (field, float64 [n] or None, stamp [s] or None).\n\n"
          "unit: auto, s, ms, us, ns, scan (0 to 1) or none. period [s]: None: from the stamps.")
      .def_ro("unit", &PointTimes::unit, "Of a value [s]; 0: no times.")
      .def_ro("text", &PointTimes::text, "What was found, or the reason why there are no times.")
      .def(
          "of",
          [=](const PointTimes& self, const Values& values,
              std::optional<double> stamp) -> std::optional<FloatArray> {
            std::vector<float> times = self.of(span_of(values), stamp);
            if (times.empty()) return std::nullopt;
            return array_of(std::move(times));
          },
          "values"_a, "stamp"_a = nb::none(),
          "Seconds from the stamp, float32 [n], NaN for invalid values; None if the values cannot "
          "be times of one scan.");
  module.def(
      "deskew",
      [](PointsArgument points, const GivenFloats& times, PoseArgument T_before_after,
         double seconds) {
        const std::optional<Eigen::Isometry3d> motion = pose_from(T_before_after);
        if (!motion) throw type_error("T_before_after: expected a float64 array, found None");
        const GivenArray<float> given = contiguous_floats(times, "times");
        PointCloud cloud = GivenPoints(points).cloud_with_intensity();
        if (given.ndim() != 1 || given.shape(0) != cloud.points.size())
          throw value_error(str("times: expected ", cloud.points.size(), ", one per point, found ",
                                description_of(times)));
        cloud.times.assign(given.data(), given.data() + given.size());
        without_lock([&] { deskew(*motion, seconds, cloud); });
        return array_of(std::move(cloud));
      },
      "points"_a, "times"_a, "T_before_after"_a, "seconds"_a,
      "Transforms points to the sensor's pose at the scan's stamp: float32 [n][4]. Assumes "
      "constant velocity, T_before_after in `seconds`.\n\n"
      "times: float32 [n], relative to the scan's stamp [s]. Raises TypeError or ValueError for "
      "other arrays.");
  module.def(
      "write_kitti_scan",
      [](const fs::path& file, PointsArgument points) {
        const PointCloud cloud = GivenPoints(points).cloud_with_intensity();
        without_lock([&] { write_kitti_scan(file, cloud); });
      },
      "file"_a, "points"_a,
      "Writes KITTI's .bin atomically. The fourth column is the intensity, or 0 without "
      "intensities. Raises Error if it cannot be written.");
  module.def("time_in_name", &time_in_name, "file"_a,
             "Parses the time [s] from a file name: SEC_NSEC.pcd, SEC.FRACTION.pcd, 16 digits of "
             "microseconds or 19 of nanoseconds. None for other names.");
  module.def(
      "read_trajectory",
      [](const fs::path& file, const std::string& format) {
        const TimedPoses read = without_lock([&] { return read_timed_poses(file, format); });
        return std::pair(read.times, array_of_poses(read.poses));
      },
      "file"_a, "format"_a = "",
      "Reads times [s], none in KITTI's format, and poses, float64 [n][4][4], in the file's "
      "frame.\n\nformat: 'kitti', 'tum', 'euroc'; '': detected. Raises InputError with file and "
      "line.");
  module.def(
      "read_extrinsic",
      [](const fs::path& file) { return Matrix4d(read_extrinsic(file).matrix()); }, "file"_a,
      "Reads T_body_lidar, float64 [4][4], from KITTI's calib.txt (Tr) or the rows of a 3 x 4 or 4 "
      "x 4 matrix. Raises InputError.");
}

}  // namespace revisit::python
