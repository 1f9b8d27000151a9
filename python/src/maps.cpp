#include <nanobind/eigen/dense.h>
#include <nanobind/stl/filesystem.h>
#include <nanobind/stl/map.h>
#include <nanobind/stl/optional.h>
#include <nanobind/stl/unique_ptr.h>
#include <nanobind/stl/vector.h>

#include <filesystem>

#include "map_store.h"
#include "module.h"
#include "points.h"
#include "revisit/loops/loop_detector.h"
#include "revisit/maps/place_recognizer.h"
#include "revisit/recognition/align.h"
#include "revisit/registration/registration.h"
#include "unlocked.h"

namespace revisit::python {
namespace {

namespace fs = std::filesystem;
using namespace nb::literals;

/// Keeps the warnings about corrupt entries.
class Recognizer : public PlaceRecognizer {
 public:
  Recognizer(const FeatureExtractor& extractor, const RecognizerOptions& options,
             std::unique_ptr<MapStore>&& map)
      : Recognizer(extractor, options, std::move(map), std::make_shared<Messages>()) {}
  std::vector<std::string> warnings() const { return messages_->all(); }

 private:
  Recognizer(const FeatureExtractor& extractor, const RecognizerOptions& options,
             std::unique_ptr<MapStore>&& map, const std::shared_ptr<Messages>& messages)
      : PlaceRecognizer(extractor, options, std::move(map),
                        [messages](const std::string& message) { messages->add(message); }),
        messages_(messages) {}
  std::shared_ptr<Messages> messages_;
};

/// View of values that `self` owns.
ReadOnlyFloats view_of_numbers(const std::vector<float>& numbers, nb::handle self) {
  return view_of(numbers.data(), {static_cast<int64_t>(numbers.size())}, self);
}

void bind_records(nb::module_& module) {
  nb::class_<Description>(module, "Description", "The feature of a scan.")
      .def_prop_ro("described", &Description::described)
      .def_ro("error", &Description::error,
              "Reason why the scan could not be described; '' if it was.")
      .def_prop_ro(
          "feature",
          [](nb::handle self) {
            return view_of_numbers(nb::cast<const Description&>(self).feature, self);
          },
          "Feature vector, read-only; empty if the scan could not be described.")
      .def("__repr__", [](const Description& scan) {
        return scan.described() ? str("<Description of ", scan.feature.size(), " dimensions>")
                                : str("<Description: none, ", scan.error, ">");
      });
  nb::class_<Loop>(module, "Loop", "The map entry most similar to a query.")
      .def_ro("index", &Loop::index,
              "Index of the entry in the recognizer, from 0 in the order of adding.")
      .def_ro("id", &Loop::id, "Id of the entry in the map.")
      .def_ro("drive", &Loop::drive)
      .def_ro("frame", &Loop::frame)
      .def_ro("time", &Loop::time, "[s], or None.")
      .def_prop_ro(
          "pose", [](const Loop& loop) { return matrix_of(loop.pose); },
          "T_world_sensor of the entry, or None.")
      .def_ro("similarity", &Loop::similarity)
      .def_ro("kth_similarity", &Loop::kth_similarity, "Similarity of the k-th best entry.")
      .def_ro("score", &Loop::score)
      .def_ro("probability", &Loop::probability,
              "Probability that the loop is correct; None without a calibration for this score.")
      .def_ro("relative_yaw", &Loop::relative_yaw,
              "yaw(query) - yaw(place), counter-clockwise [rad], or None.")
      .def_ro("ambiguous", &Loop::ambiguous,
              "The place lies on a stretch of its drive that looks the same for much longer than "
              "usual, e.g. a tunnel. Ambiguous loops are not accepted.")
      .def_ro("accepted", &Loop::accepted,
              "The score reaches the threshold, and enough of the places can be distinguished. A "
              "registered loop must also be accepted by registration. False without a threshold.")
      .def("__repr__", [](const Loop& loop) {
        return str("<Loop to entry ", loop.index, ", score ", loop.score,
                   loop.accepted ? ", accepted>" : ">");
      });
}

void bind_recognizer(nb::module_& module) {
  nb::class_<Recognizer>(module, "PlaceRecognizer",
                         "Stores scans and recognizes their places, one scan at a time. With a "
                         "map, every entry is on disk "
                         "when add() returns. Thread-safe.")
      .def(
          "__init__",
          [](Recognizer* self, const FeatureExtractor& extractor, OpenMap* map,
             const std::string& align, const ImageGeometry& geometry, int64_t warmup,
             std::optional<double> threshold, double target_precision, int k,
             const std::optional<std::string>& score, PoseArgument mount, double local_map) {
            const RecognizerOptions options{
                .mount = pose_from(mount).value_or(Eigen::Isometry3d::Identity()),
                .align = parse_align_case(align),
                .geometry = geometry,
                .warmup = warmup,
                .threshold = threshold,
                .target_precision = target_precision,
                .k = k,
                .score = score ? std::optional(parse_score(*score)) : std::nullopt,
                .local_map = local_map};
            const auto make = [&](std::unique_ptr<MapStore>&& store) {
              new (self) Recognizer(extractor, options, std::move(store));
            };
            without_lock([&] { map ? map->give(make) : make(nullptr); });
          },
          "extractor"_a, "map"_a.none() = nb::none(), nb::kw_only(), "align"_a = "none",
          "geometry"_a = ImageGeometry(), "warmup"_a = RecognizerOptions().warmup,
          "threshold"_a = nb::none(), "target_precision"_a = RecognizerOptions().target_precision,
          "k"_a = RecognizerOptions().k, "score"_a = nb::none(), "mount"_a = nb::none(),
          "local_map"_a = 0,
          "map: store whose entries are loaded and which the recognizer then owns; None: entries "
          "are not stored on disk.\n"
          "warmup: number of scans from which a feature estimates its statistics (rings: their "
          "mean).\n"
          "threshold: minimum score for acceptance; None: the score that reaches "
          "target_precision.\n"
          "target_precision: target fraction of accepted loops that are correct, by the "
          "calibration of the map or the feature.\n"
          "score: 'margin' (2 c1 - ck), 'distinct-margin' (ck of the k-th distinct place) or "
          "'similarity' (c1); None: the score that the feature was calibrated for, "
          "'distinct-margin' for rings.\n"
          "mount: transforms points to x forward, y left, z up, float64 [4][4] (parse_mount()).\n"
          "local_map: must equal that of the LoopDetector [m]; 0: single scans.\n"
          "Raises InputError if the map was made with another feature.")
      .def(
          "describe",
          [](const Recognizer& self, PointsArgument points) {
            const GivenPoints given(points);
            return without_lock([&] { return self.describe(given.view()); });
          },
          "points"_a,
          "Computes the feature of a scan: points in the sensor's frame [m]. Does not raise if the "
          "scan cannot be described; see Description.error.")
      .def(
          "query",
          [](const Recognizer& self, const Description& scan, const std::vector<int64_t>& exclude) {
            return self.query(scan, exclude);
          },
          nb::call_guard<Unlocked>(), "scan"_a, "exclude"_a = std::vector<int64_t>(),
          "Returns the best entry. `exclude`: indices of entries to skip, e.g. temporal neighbors "
          "of the scan. None if no entry is left or the scan was not described.")
      .def(
          "add",
          [](Recognizer& self, const Description& scan, const std::string& drive, int64_t frame,
             std::optional<double> time, PoseArgument pose,
             const std::optional<PointsArgument>& points) {
            MapEntry entry{.drive = drive, .frame = frame, .time = time, .pose = pose_from(pose)};
            std::optional<PointCloud> cloud;
            if (points) cloud = GivenPoints(*points).cloud();
            return without_lock([&] {
              if (cloud) {
                transform(self.mount(), *cloud);
                entry.cloud = compact_cloud(*cloud, self.mount());
              }
              return self.add(scan, std::move(entry));
            });
          },
          "scan"_a, nb::kw_only(), "drive"_a = "", "frame"_a = 0, "time"_a = nb::none(),
          "pose"_a = nb::none(), "points"_a = nb::none(),
          "Adds an entry and returns its index. `pose`: T_world_sensor, float64 [4][4]. "
          "`points`: as in describe(); LoopDetector registers later scans with them.")
      .def(
          "remove",
          [](Recognizer& self, const std::vector<int64_t>& indices) {
            return self.remove(indices);
          },
          nb::call_guard<Unlocked>(), "indices"_a,
          "Removes the entries at these indices from the recognizer and its map. The other entries "
          "keep their indices. Returns the number of entries removed by this call.")
      .def("__len__", &Recognizer::size, nb::call_guard<Unlocked>())
      .def_prop_ro("threshold", &Recognizer::threshold, nb::call_guard<Unlocked>())
      .def_prop_ro(
          "is_calibrated", &Recognizer::is_calibrated, nb::call_guard<Unlocked>(),
          "The map has a threshold or a calibration for query(), i.e. without registration.")
      .def_prop_ro("warnings", &Recognizer::warnings, "Warnings about unusable content of the map.")
      .def("refresh", &Recognizer::refresh, nb::call_guard<Unlocked>(),
           "Loads the entries that other processes added to the map, and drops those they removed.")
      .def("refresh_if_updated", &Recognizer::refresh_if_updated, nb::call_guard<Unlocked>(),
           "Calls refresh() if the map reports an update.")
      .def(
          "calibrate", [](Recognizer& self, double threshold) { self.calibrate(threshold); },
          nb::call_guard<Unlocked>(), "threshold"_a,
          "Stores the threshold in the map and replaces its calibration.")
      .def_static(
          "fingerprint_of",
          [](const FeatureExtractor& extractor, const std::string& align,
             const ImageGeometry& geometry, double local_map) {
            return PlaceRecognizer::fingerprint_of(
                extractor,
                {.align = parse_align_case(align), .geometry = geometry, .local_map = local_map});
          },
          "extractor"_a, nb::kw_only(), "align"_a = "none", "geometry"_a = ImageGeometry(),
          "local_map"_a = 0, "Configuration fingerprint that a map of this feature must have.");
}

void bind_loop_detector(nb::module_& module) {
  nb::class_<Detection>(module, "Detection", "The result for one scan.")
      .def(
          "__init__",
          [](Detection* self, const std::string& error) { new (self) Detection{.error = error}; },
          "error"_a, "Result for a scan that could not be read.")
      .def_ro("index", &Detection::index,
              "Index of the scan's entry in the recognizer; None if it was not stored.")
      .def_ro("error", &Detection::error, "Reason why the scan was not described; '' if it was.")
      .def_ro("loop", &Detection::loop, "The most similar entry, or None.")
      .def_ro("registered", &Detection::registered,
              "Relative pose to the entry; None if the loop is too dissimilar for registration. "
              "Accepted if and only if the loop is.")
      .def_prop_ro(
          "rejection_reason", [](const Detection& self) { return self.rejection; },
          "Why the loop is not accepted: 'score' (too low), 'similarity' (too low for "
          "registration), 'ambiguous', 'no points' (the entry has none) or 'registration' "
          "(rejected by it); '' if accepted.");
  nb::class_<LoopDetector>(
      module, "LoopDetector",
      "Detects loop closures in the scans of one drive, given in order. Every scan is described, "
      "compared with the entries that are not excluded, and added.")
      .def(
          "__init__",
          [](LoopDetector* self, Recognizer& recognizer, const std::string& drive,
             const std::string& exclusion, const std::string& keyframes, std::optional<bool> verify,
             std::optional<double> threshold, double target_precision, bool keep_clouds,
             double local_map) {
            new (self) LoopDetector(recognizer, {.drive = drive,
                                                 .exclusion = parse_exclusion(exclusion),
                                                 .keyframes = keyframes,
                                                 .verify = verify,
                                                 .threshold = threshold,
                                                 .target_precision = target_precision,
                                                 .keep_clouds = keep_clouds,
                                                 .local_map = local_map});
          },
          nb::keep_alive<1, 2>(), "recognizer"_a, nb::kw_only(), "drive"_a = "",
          "exclusion"_a = to_string(Exclusion()), "keyframes"_a = "all", "verify"_a = nb::none(),
          "threshold"_a = nb::none(), "target_precision"_a = LoopDetectorOptions().target_precision,
          "keep_clouds"_a = true, "local_map"_a = 0,
          "drive: name of the drive in the map.\n"
          "exclusion: recent scans that are not compared: 'frames=N', 'seconds=T', 'meters=L' or "
          "'none'.\n"
          "keyframes: scans that are stored: 'all', 'meters=L' or 'similarity=S'. All scans are "
          "compared.\n"
          "verify: register the most similar entries, and accept by the inlier ratio, too. "
          "Default: "
          "True if the feature gives the relative yaw (rings do) and points are kept. If False, "
          "the recognizer accepts.\n"
          "threshold: minimum similarity + inlier ratio of accepted registered loops; None: the "
          "value that reaches target_precision.\n"
          "target_precision: target fraction of accepted registered loops that are correct, by "
          "the calibration.\n"
          "keep_clouds: store about 20 kB of points with each entry, for registration.\n"
          "local_map: describe and register the points of the last `local_map` meters, "
          "accumulated by the poses; 0: single scans.")
      .def(
          "take",
          [](LoopDetector& self, PointsArgument points, int64_t frame, std::optional<double> time,
             PoseArgument pose) {
            const GivenPoints given(points);
            const ScanStamp stamp{frame, time, pose_from(pose)};
            return without_lock([&] { return self.take(given.view(), stamp); });
          },
          "points"_a, nb::kw_only(), "frame"_a, "time"_a = nb::none(), "pose"_a = nb::none(),
          "points: in the sensor's frame [m]. time: [s]. pose: T_world_sensor, float64 [4][4].\n"
          "Raises UsageError if the exclusion needs a time or a pose that is not given.")
      .def_prop_ro("drive", &LoopDetector::drive,
                   "Name of the drive in the map, known after the first scan.")
      .def_prop_ro("verifies", &LoopDetector::verifies, "Accepted loops are registered.")
      .def_prop_ro("threshold", &LoopDetector::threshold, nb::call_guard<Unlocked>(),
                   "Minimum score of accepted loops, or None.");
}

}  // namespace

void bind_maps(nb::module_& module) {
  bind_map_store(module);
  bind_records(module);
  bind_recognizer(module);
  bind_loop_detector(module);
}

}  // namespace revisit::python
