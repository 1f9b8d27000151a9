#include <nanobind/eigen/dense.h>
#include <nanobind/stl/filesystem.h>
#include <nanobind/stl/optional.h>
#include <nanobind/stl/unique_ptr.h>
#include <nanobind/stl/variant.h>
#include <nanobind/stl/vector.h>

#include <algorithm>
#include <filesystem>
#include <mutex>
#include <variant>

#include "map_store.h"
#include "module.h"
#include "points.h"
#include "revisit/loops/loop_detector.h"
#include "revisit/maps/map.h"
#include "revisit/recognition/align.h"
#include "revisit/registration/registration.h"
#include "unlocked.h"

namespace revisit::python {
namespace {

namespace fs = std::filesystem;
using namespace nb::literals;

struct Warnings {
  Messages warnings;
  MapStore::Warn warn() {
    return [this](const std::string& message) { warnings.add(message); };
  }
};
/// Keeps its messages and those of its detectors.
struct PythonMap : Warnings, Map {
  PythonMap(const auto& source, const MapOptions& options, auto&&... store)
      : Map(source, options, std::forward<decltype(store)>(store)..., warn()) {}

  std::vector<Detection> locate(const PointsView& points) {
    const std::scoped_lock one(locating_);
    if (!locator_) locator_.emplace(*this, LoopDetectorOptions{.warn = warn()});
    return locator_->locate(points);
  }

 private:
  std::mutex locating_;
  std::optional<LoopDetector> locator_;
};

constexpr const char* kLocateDoc =
    "Where in the map a single scan of unknown pose was taken, as a list of Detection: the best "
    "place and, if it is not accepted, up to two others. Nothing is added. The pose in "
    "the world of the map is loop.pose @ registered.T_place_query.\n\n"
    "points: in the sensor's frame [m].";

void bind_records(nb::module_& module) {
  nb::class_<Description>(module, "Description", "The feature of a scan.")
      .def_prop_ro("described", &Description::described, "The scan could be described.")
      .def_ro("error", &Description::error,
              "Reason why the scan could not be described; '' if it was.")
      .def_prop_ro(
          "feature",
          [](nb::handle self) { return view_of(nb::cast<const Description&>(self).feature, self); },
          "Feature vector, read-only; empty if the scan could not be described.")
      .def("__repr__", [](const Description& scan) {
        return scan.described() ? str("<Description of ", scan.feature.size(), " dimensions>")
                                : str("<Description: none, ", scan.error, ">");
      });
  nb::class_<Loop>(module, "Loop", "The map entry most similar to a query.")
      .def_ro("index", &Loop::index,
              "Index of the entry in the Map, from 0 in the order of adding.")
      .def_ro("id", &Loop::id, "Id of the entry in the map.")
      .def_ro("drive", &Loop::drive, "Drive of the entry.")
      .def_ro("frame", &Loop::frame, "Frame of the entry in its drive.")
      .def_ro("time", &Loop::time, "[s], or None.")
      .def_prop_ro(
          "pose", [](const Loop& loop) { return matrix_of(loop.pose); },
          "T_world_sensor of the entry, float64 [4][4] [m], or None.")
      .def_ro("similarity", &Loop::similarity,
              "Similarity of the entry to the query; for rings -1 to 1.")
      .def_ro("kth_similarity", &Loop::kth_similarity, "Similarity of the k-th best entry.")
      .def_ro("score", &Loop::score, "Score that the threshold of LoopDetector applies to.")
      .def_ro("probability", &Loop::probability,
              "Probability that the loop is correct, by LoopDetector; None without a calibration.")
      .def_ro("relative_yaw", &Loop::relative_yaw,
              "yaw(query) - yaw(place), counter-clockwise [rad], or None.")
      .def_ro("ambiguous", &Loop::ambiguous,
              "The place lies on a stretch of its drive that looks the same for much longer than "
              "usual, e.g. a tunnel. Ambiguous loops are not accepted.")
      .def("__repr__", [](const Loop& loop) {
        return str("<Loop to frame ", loop.frame, " of '", loop.drive, "', score ", loop.score,
                   ">");
      });
}

void bind_map(nb::module_& module) {
  nb::class_<PythonMap>(module, "Map",
                        "Entries of a map, in memory and on disk: with a file, every entry is "
                        "there when add() returns. Thread-safe.")
      .def(
          "__init__",
          [](PythonMap* self, const std::optional<fs::path>& file,
             const std::optional<std::string>& sensor, const FeatureExtractor* extractor,
             const std::string& align, const ImageGeometry& geometry, int64_t warmup, int k,
             const std::optional<std::string>& score, int threads, PoseArgument mount,
             double local_map) {
            const MapOptions options{
                .sensor = extractor ? "" : sensor.value_or(""),
                .threads = threads,
                .mount = pose_from(mount).value_or(Eigen::Isometry3d::Identity()),
                .local_map = local_map,
                .warmup = warmup,
                .k = k,
                .score = score ? std::optional(parse_score(*score)) : std::nullopt,
                .align = parse_align_case(align),
                .geometry = geometry};
            without_lock([&] {
              if (!extractor) {
                new (self) PythonMap(file.value_or(""), options);
                return;
              }
              const MapFingerprint fingerprint = fingerprint_of(*extractor, options);
              new (self)
                  PythonMap(*extractor, options,
                            file ? open_map(*file, MapAccess::kWrite, &fingerprint) : nullptr);
            });
          },
          "file"_a = nb::none(), "sensor"_a = nb::none(), nb::kw_only(),
          "extractor"_a.none() = nb::none(), "align"_a = "none", "geometry"_a = ImageGeometry(),
          "warmup"_a = MapOptions().warmup, "k"_a = MapOptions().k, "score"_a = nb::none(),
          "threads"_a = MapOptions().threads, "mount"_a = nb::none(),
          "local_map"_a = MapOptions().local_map,
          "Opens a map as open_map(), or one of another feature.\n\n"
          "extractor: feature of scans; None: ring descriptors for the sensor.\n"
          "align, geometry: of features of range images.\n"
          "score: 'margin' (2 c1 - ck), 'distinct-margin' (ck of the k-th distinct place) or "
          "'similarity' (c1); None: the score that the feature was calibrated for, "
          "'distinct-margin' for rings.\n"
          "mount: transforms points to x forward, y left, z up, float64 [4][4] (parse_mount()). "
          "Raises as open_map().")
      .def(
          "describe",
          [](const PythonMap& self, PointsArgument points) {
            const GivenPoints given(points);
            return without_lock([&] { return self.describe(given.view()); });
          },
          "points"_a,
          "Computes the feature of a scan: points in the sensor's frame [m]. Does not raise if the "
          "scan cannot be described; see Description.error.")
      .def(
          "query",
          [](const PythonMap& self, const Description& scan, const std::vector<int64_t>& exclude) {
            return self.query(scan, exclude);
          },
          nb::call_guard<Unlocked>(), "scan"_a, "exclude"_a = std::vector<int64_t>(),
          "Returns the best entry. `exclude`: indices of entries to skip, e.g. temporal neighbors "
          "of the scan. None if no entry is left or the scan was not described. Raises UsageError "
          "for a scan of another feature.")
      .def(
          "locate",
          [](PythonMap& self, PointsArgument points) {
            const GivenPoints given(points);
            return without_lock([&] { return self.locate(given.view()); });
          },
          "points"_a, kLocateDoc)
      .def(
          "add",
          [](PythonMap& self, const Description& scan, const std::string& drive, int64_t frame,
             std::optional<double> time, PoseArgument pose,
             const std::optional<PointsArgument>& points) {
            std::vector<MapEntry> entries{{.drive = drive,
                                           .frame = frame,
                                           .time = time,
                                           .pose = pose_from(pose),
                                           .feature = scan.feature}};
            std::optional<PointCloud> cloud;
            if (points) cloud = GivenPoints(*points).cloud();
            return without_lock([&] {
              if (cloud) {
                const Eigen::Isometry3d mount = self.options().mount;
                transform(mount, *cloud);
                entries.front().cloud = compact_cloud(*cloud, mount);
              }
              return self.add(std::move(entries), scan.made_by).front();
            });
          },
          "scan"_a, nb::kw_only(), "drive"_a = "", "frame"_a = 0, "time"_a = nb::none(),
          "pose"_a = nb::none(), "points"_a = nb::none(),
          "Adds an entry and returns its index. `pose`: T_world_sensor, float64 [4][4]. `points`: "
          "as in describe(); LoopDetector registers later scans with them. Raises UsageError for a "
          "scan that was not described, Error if it cannot be written.")
      .def(
          "remove",
          [](PythonMap& self, const std::vector<int64_t>& indices) { return self.remove(indices); },
          nb::call_guard<Unlocked>(), "indices"_a,
          "Removes the entries at these indices, also from the file. The other entries keep their "
          "indices. Returns the number of entries removed by this call. Raises UsageError for an "
          "index that does not exist.")
      .def("__len__", &PythonMap::size, nb::call_guard<Unlocked>())
      .def_prop_ro(
          "sensor", [](const PythonMap& self) { return self.options().sensor; },
          nb::call_guard<Unlocked>(),
          "Sensor of the shipped ring model; '' for another feature, or until the first scan.")
      .def_prop_ro(
          "warnings", [](const PythonMap& self) { return self.warnings.all(); },
          "Messages about the sensor that was found, corrupt entries, and calibrations that "
          "detectors ignore.")
      .def("refresh", &PythonMap::refresh, nb::call_guard<Unlocked>(),
           "Loads the entries that other processes added to the map, and drops those they removed. "
           "Returns the number of loadings so far; takes microseconds if nothing changed.");
}

struct MapOwner {
  nb::object owner;
};
/// Keeps its Map alive.
struct PythonDetector : MapOwner, LoopDetector {
  using LoopDetector::LoopDetector;
  int64_t next_frame = 0;
};

using MapArgument = std::variant<nb::handle_t<PythonMap>, std::optional<fs::path>>;

/// The given Map, or one that is opened.
nb::object map_of(const MapArgument& map, const std::string& sensor) {
  if (const auto* given = std::get_if<nb::handle_t<PythonMap>>(&map)) {
    if (!sensor.empty())
      throw UsageError("sensor: '", sensor, "', but a Map is given; give it to open_map()");
    return nb::borrow(*given);
  }
  const fs::path file = std::get<std::optional<fs::path>>(map).value_or("");
  return nb::cast(without_lock(
      [&] { return std::make_unique<PythonMap>(file, MapOptions{.sensor = sensor}); }));
}

void bind_loop_detector(nb::module_& module) {
  nb::class_<Detection>(module, "Detection", "The result for one scan.")
      .def(
          "__init__",
          [](Detection* self, const std::string& error) { new (self) Detection{.error = error}; },
          "error"_a, "Result for a scan that could not be read.")
      .def_ro("index", &Detection::index,
              "Index of the scan's entry in the Map; None if it was not stored.")
      .def_ro("error", &Detection::error, "Reason why the scan was not described; '' if it was.")
      .def_ro("loop", &Detection::loop, "The most similar entry, or None.")
      .def_ro("registered", &Detection::registered,
              "Relative pose to the entry; None if the loop is too dissimilar for registration.")
      .def_ro("accepted", &Detection::accepted,
              "The loop's score reaches the threshold, the loop is not ambiguous and, if loops are "
              "registered, it fits.")
      .def_ro(
          "questioned", &Detection::questioned,
          "Frames of earlier scans whose accepted loops this loop and others contradict: remove "
          "them from the pose graph.")
      .def_ro("rejection", &Detection::rejection,
              "Why the loop is not accepted: 'score' (too low), 'similarity' (too low for "
              "registration), 'ambiguous', 'no points' (the entry has none), 'registration' "
              "(points do not fit), 'contradicted' (by free space), 'hidden' (by something near), "
              "'odometry' (by the poses or the registered motion) or 'inconsistent' (with other "
              "loops of the last 30 m); '' if "
              "accepted.");
  nb::class_<PythonDetector>(
      module, "LoopDetector",
      "Detects loop closures in the scans of one drive, given in order. Every scan is described, "
      "compared with the entries that are not excluded, and added.")
      .def(
          "__init__",
          [](PythonDetector* self, const MapArgument& map, const std::string& drive,
             const std::string& exclusion, const std::string& keyframes, std::optional<bool> verify,
             std::optional<double> threshold, std::optional<double> target_precision,
             bool keep_clouds, const std::string& odometry_gate,
             const std::optional<std::string>& sensor) {
            const nb::object owner = map_of(map, sensor.value_or(""));
            PythonMap& used = nb::cast<PythonMap&>(owner);
            const LoopDetectorOptions options{.drive = drive,
                                              .exclusion = parse_exclusion(exclusion),
                                              .keyframes = keyframes,
                                              .verify = verify,
                                              .threshold = threshold,
                                              .target_precision = target_precision,
                                              .keep_clouds = keep_clouds,
                                              .odometry_gate = parse_odometry_gate(odometry_gate),
                                              .warn = used.warn()};
            without_lock([&] { new (self) PythonDetector(used, options); });
            self->owner = owner;
          },
          "map"_a = nb::none(), nb::kw_only(), "drive"_a = "",
          "exclusion"_a = to_string(Exclusion()), "keyframes"_a = "all", "verify"_a = nb::none(),
          "threshold"_a = nb::none(), "target_precision"_a = nb::none(), "keep_clouds"_a = true,
          "odometry_gate"_a = "2,0.1,0.5", "sensor"_a = nb::none(),
          "map: a Map; or the file or server's address of one of ring descriptors, which "
          "open_map() opens; None: a temporary map.\n"
          "sensor: of a map that is opened, as of open_map().\n"
          "drive: name of the drive in the map.\n"
          "exclusion: recent scans that are not compared: 'meters=L' by poses or else by "
          "registered "
          "motion, 'frames=N', 'seconds=T' or 'none'.\n"
          "keyframes: scans that are stored: 'all', 'meters=L' or 'similarity=S'. All scans are "
          "compared.\n"
          "verify: register the most similar entries, and judge them by free space. "
          "Default: True if the feature gives the relative yaw (rings do) and points are kept.\n"
          "threshold: minimum score of accepted loops: 0.1 similarity + level - contradiction if "
          "loops are registered, else the score of the Map; None: the value that reaches "
          "target_precision.\n"
          "target_precision: target fraction of accepted loops that are correct, by the "
          "calibration; None: 0.99 if loops are registered, else 0.95.\n"
          "keep_clouds: store about 20 kB of points with each entry, for registration.\n"
          "odometry_gate: 'BASE,RATE,HEIGHT': loops may differ from the poses by BASE + RATE * "
          "path horizontally, HEIGHT + RATE / 20 * path vertically [m], and 2.5 + RATE / 20 * path "
          "in tilt [deg]; 'none': poses judge no loops.")
      .def(
          "take",
          [](PythonDetector& self, PointsArgument points, std::optional<int64_t> frame,
             std::optional<double> time, PoseArgument pose) {
            const GivenPoints given(points);
            const ScanStamp stamp{frame.value_or(self.next_frame), time, pose_from(pose)};
            self.next_frame = std::max(self.next_frame, stamp.frame + 1);
            return without_lock([&] { return self.take(given.view(), stamp); });
          },
          "points"_a, nb::kw_only(), "frame"_a = nb::none(), "time"_a = nb::none(),
          "pose"_a = nb::none(),
          "Takes the next scan of the drive. A failure to describe it is in Detection.error.\n\n"
          "points: in the sensor's frame [m].\n"
          "frame: above that of the scan before; None: the next. time: [s].\n"
          "pose: T_world_sensor, float64 [4][4] [m].\n"
          "Raises UsageError if the exclusion needs a time that is not given.")
      .def(
          "locate",
          [](PythonDetector& self, PointsArgument points) {
            const GivenPoints given(points);
            return without_lock([&] { return self.locate(given.view()); });
          },
          "points"_a, kLocateDoc)
      .def_prop_ro(
          "map", [](const PythonDetector& self) { return nb::cast<PythonMap*>(self.owner); },
          nb::rv_policy::reference_internal, "Its map.")
      .def_prop_ro("drive", &PythonDetector::drive,
                   "Name of the drive in the map, known after the first scan.")
      .def_prop_ro("verifies", &PythonDetector::verifies, "Accepted loops are registered.")
      .def_prop_ro("threshold", &PythonDetector::threshold, nb::call_guard<Unlocked>(),
                   "Minimum score of accepted loops, or None.");
}

}  // namespace

void bind_maps(nb::module_& module) {
  bind_map_store(module);
  bind_records(module);
  bind_map(module);
  bind_loop_detector(module);
}

}  // namespace revisit::python
