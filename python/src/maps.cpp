#include <nanobind/eigen/dense.h>
#include <nanobind/stl/filesystem.h>
#include <nanobind/stl/map.h>
#include <nanobind/stl/optional.h>
#include <nanobind/stl/unique_ptr.h>
#include <nanobind/stl/vector.h>

#include <filesystem>

#include "listener.h"
#include "map_store.h"
#include "messages.h"
#include "module.h"
#include "points.h"
#include "poses.h"
#include "revisit/loops/loop_detector.h"
#include "revisit/loops/loop_summary.h"
#include "revisit/loops/pose_files.h"
#include "revisit/maps/place_recognizer.h"
#include "revisit/recognition/mount.h"
#include "revisit/registration/compact_cloud.h"
#include "strings.h"

namespace revisit::python {
namespace {

namespace fs = std::filesystem;
using namespace nb::literals;
using namespace pipeline;

/// One that keeps what it has to say of damaged places.
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

/// A view of numbers that `self` holds.
ReadOnlyFloats view_of_numbers(const std::vector<float>& numbers, nb::handle self) {
  return view_of(numbers.data(), {static_cast<int64_t>(numbers.size())}, self);
}

void bind_records(nb::module_& module) {
  nb::class_<Description>(module, "Description", "What a scan looks like.")
      .def_prop_ro("described", &Description::described)
      .def_ro("why_not", &Description::why_not, "When it could not be described: the reason.")
      .def_prop_ro(
          "feature",
          [](nb::handle self) {
            return view_of_numbers(nb::cast<const Description&>(self).feature, self);
          },
          "Its numbers, read-only; none when it could not be described.")
      .def("__repr__", [](const Description& scan) {
        return scan.described() ? str("<Description of ", scan.feature.size(), " numbers>")
                                : str("<Description: none, ", scan.why_not, ">");
      });
  nb::class_<Loop>(module, "Loop", "A place that looks like the scan asked.")
      .def_ro("position", &Loop::position,
              "Of the place in the recogniser, counted from 0 as it came to know them.")
      .def_ro("id", &Loop::id, "Of the place in the map.")
      .def_ro("drive", &Loop::drive)
      .def_ro("frame", &Loop::frame)
      .def_ro("time", &Loop::time, "[s], or None.")
      .def_prop_ro(
          "pose", [](const Loop& loop) { return matrix_of(loop.pose); },
          "T_world_sensor of the place, or None.")
      .def_ro("similarity", &Loop::similarity)
      .def_ro("runner_up", &Loop::runner_up, "The similarity of the k-th best.")
      .def_ro("score", &Loop::score)
      .def_ro("probability", &Loop::probability,
              "That the place is right; None without a calibration for this score.")
      .def_ro("turn", &Loop::turn,
              "Heading of the scan less heading of the place, counter-clockwise [rad], or None.")
      .def_ro("ambiguous", &Loop::ambiguous,
              "The place lies where its drive looks the same for much longer than usual, as in a "
              "tunnel; the loop is not accepted.")
      .def_ro("accepted", &Loop::accepted,
              "The score reaches the threshold among enough places that can be told apart; a loop "
              "that was registered also fits; False without a threshold.")
      .def("__repr__", [](const Loop& loop) {
        return str("<Loop to place ", loop.position, ", score ", loop.score,
                   loop.accepted ? ", accepted>" : ">");
      });
}

void bind_recognizer(nb::module_& module) {
  nb::class_<Recognizer>(
      module, "PlaceRecognizer",
      "Knows places and recognises them, one scan at a time. With a map every place is on the disk "
      "when add() returns. Any number of threads may call.")
      .def(
          "__init__",
          [](Recognizer* self, const FeatureExtractor& extractor, OpenMap* map,
             const std::string& align, const ImageGeometry& geometry, int64_t first_stretch,
             std::optional<double> threshold, double precision, int k,
             const std::optional<std::string>& score, PoseArgument mount, double local_map) {
            const RecognizerOptions options{
                .mount = pose_from(mount).value_or(Eigen::Isometry3d::Identity()),
                .align = parse_align_case(align),
                .geometry = geometry,
                .first_stretch = first_stretch,
                .threshold = threshold,
                .precision = precision,
                .k = k,
                .score = score ? std::optional(parse_score(*score)) : std::nullopt,
                .local_map = local_map};
            const auto make = [&](std::unique_ptr<MapStore>&& store) {
              new (self) Recognizer(extractor, options, std::move(store));
            };
            without_lock([&] { map ? map->give(make) : make(nullptr); });
          },
          "extractor"_a, "map"_a.none() = nb::none(), nb::kw_only(), "align"_a = "none",
          "geometry"_a = ImageGeometry(), "first_stretch"_a = RecognizerOptions().first_stretch,
          "threshold"_a = nb::none(), "precision"_a = RecognizerOptions().precision,
          "k"_a = RecognizerOptions().k, "score"_a = nb::none(), "mount"_a = nb::none(),
          "local_map"_a = 0,
          "map: its places are known at once, and it belongs to the recogniser; None: nothing is "
          "kept.\n"
          "first_stretch: a feature that learns from the map's scans does so from this many.\n"
          "threshold: of the score, from which a loop is accepted; None: from where the precision "
          "is reached.\n"
          "precision: the share of accepted loops that are to be right, as far as the calibration "
          "of the map or the feature holds.\n"
          "score: 'margin' (2 c1 - ck), 'distinct-margin' (the same with the k-th distinct place) "
          "or 'similarity' (c1); None: what the feature was calibrated for, for rings "
          "'distinct-margin'.\n"
          "mount: takes points to x forward, y left, z up, float64 [4][4] (parse_mount()).\n"
          "local_map: LoopDetector's, which fills the map; 0: not.\n"
          "Raises InputError when the map was made with another feature.")
      .def(
          "describe",
          [](const Recognizer& self, PointsArgument points) {
            const GivenPoints given(points);
            return without_lock([&] { return self.describe(given.view()); });
          },
          "points"_a,
          "What a scan looks like: points in the sensor's frame [m]. A scan that cannot be "
          "described is no error.")
      .def(
          "query",
          [](const Recognizer& self, const Description& scan, const std::vector<int64_t>& without) {
            return self.query(scan, without);
          },
          nb::call_guard<Unlocked>(), "scan"_a, "without"_a = std::vector<int64_t>(),
          "The best place but those at the positions `without`, which are of the same "
          "moment; None when there is none or the scan was not described.")
      .def(
          "add",
          [](Recognizer& self, const Description& scan, const std::string& drive, int64_t frame,
             std::optional<double> time, PoseArgument pose,
             const std::optional<PointsArgument>& points) {
            StoredPlace place{
                .drive = drive, .frame = frame, .time = time, .pose = pose_from(pose)};
            std::optional<PointCloud> cloud;
            if (points) cloud = GivenPoints(*points).cloud();
            return without_lock([&] {
              if (cloud) {
                transform(self.mount(), *cloud);
                place.cloud = compact_cloud(*cloud, self.mount());
              }
              return self.add(scan, std::move(place));
            });
          },
          "scan"_a, nb::kw_only(), "drive"_a = "", "frame"_a = 0, "time"_a = nb::none(),
          "pose"_a = nb::none(), "points"_a = nb::none(),
          "Adds a place and returns its position. `pose`: T_world_sensor, float64 [4][4]. "
          "`points`: as describe() has them; LoopDetector registers later scans with them.")
      .def(
          "remove",
          [](Recognizer& self, const std::vector<int64_t>& positions) {
            return self.remove(positions);
          },
          nb::call_guard<Unlocked>(), "positions"_a,
          "Removes the places at these positions, from the map, too: no query answers with them. "
          "The "
          "others keep their positions. Returns how many had not been removed.")
      .def("__len__", &Recognizer::size, nb::call_guard<Unlocked>())
      .def_prop_ro("threshold", &Recognizer::threshold, nb::call_guard<Unlocked>())
      .def_prop_ro(
          "is_calibrated", &Recognizer::is_calibrated, nb::call_guard<Unlocked>(),
          "The map keeps a threshold or a calibration of query(), not of registered loops.")
      .def_prop_ro(
          "is_calibrated_for_registered",
          [](const Recognizer& self) { return self.verified_calibration().has_value(); },
          nb::call_guard<Unlocked>(), "The map keeps a calibration of registered loops.")
      .def_prop_ro("warnings", &Recognizer::warnings, "Of what the map has and cannot be used.")
      .def("refresh", &Recognizer::refresh, nb::call_guard<Unlocked>(),
           "Takes in what others have added to the map, and out what they have removed.")
      .def("refresh_on_news", &Recognizer::refresh_on_news, nb::call_guard<Unlocked>(),
           "The same when the map says that there is something.")
      .def(
          "calibrate", [](Recognizer& self, double threshold) { self.calibrate(threshold); },
          nb::call_guard<Unlocked>(), "threshold"_a,
          "Keeps the threshold in the map, in the place of a calibration.")
      .def_static(
          "identity_of",
          [](const FeatureExtractor& extractor, const std::string& align,
             const ImageGeometry& geometry, double local_map) {
            return PlaceRecognizer::identity_of(
                extractor,
                {.align = parse_align_case(align), .geometry = geometry, .local_map = local_map});
          },
          "extractor"_a, nb::kw_only(), "align"_a = "none", "geometry"_a = ImageGeometry(),
          "local_map"_a = 0, "What a map of this feature must have been made with.");
}

void bind_loop_detector(nb::module_& module) {
  nb::class_<Detection>(module, "Detection", "The result for one scan.")
      .def(
          "__init__",
          [](Detection* self, const std::string& why_not) {
            new (self) Detection{.why_not = why_not};
          },
          "why_not"_a, "Of a scan that could not be read.")
      .def_ro("position", &Detection::position,
              "Of its place in the recogniser; None for a scan that was not stored.")
      .def_ro("why_not", &Detection::why_not, "The scan was not described: the reason.")
      .def_ro("loop", &Detection::loop, "The most similar place, or None.")
      .def_ro("registered", &Detection::registered,
              "How the scan lies to the place, of a loop that is similar enough to be registered. "
              "Accepted when the loop is.")
      .def_prop_ro(
          "refusal", [](const Detection& self) { return name_of(self.refusal); },
          "Why the loop is not accepted: 'score' (too low), 'similarity' (not enough to be "
          "registered), 'ambiguous', 'no points' (its place was stored without) or 'registration' "
          "(they do not fit); else ''.");
  nb::class_<LoopSummary>(module, "LoopSummary",
                          "What became of the scans of a drive: also why loops are not accepted.")
      .def(
          "__init__",
          [](LoopSummary* self, const std::string& exclusion, std::optional<double> threshold) {
            new (self) LoopSummary(parse_exclusion(exclusion), threshold);
          },
          "exclusion"_a, "threshold"_a.none(), "As LoopDetector has them.")
      .def("add", &LoopSummary::add, "found"_a)
      .def_prop_ro("scans", &LoopSummary::scans)
      .def_prop_ro("left_out", &LoopSummary::left_out, "Scans that could not be described.")
      .def("__str__", &LoopSummary::text);
  module.def(
      "check_exclusion", [](const std::string& text) { parse_exclusion(text); }, "exclusion"_a,
      "Raises UsageError for a text that LoopDetector does not take.");
  nb::class_<LoopDetector>(
      module, "LoopDetector",
      "Takes the scans of one drive in order and says where each was before: every scan is "
      "described, compared with the places that are not excluded, and added.")
      .def(
          "__init__",
          [](LoopDetector* self, Recognizer& recognizer, const std::string& drive,
             const std::string& exclusion, const std::string& keyframes, std::optional<bool> verify,
             std::optional<double> threshold, double precision, bool keep_clouds,
             double local_map) {
            new (self) LoopDetector(recognizer, {.drive = drive,
                                                 .exclusion = parse_exclusion(exclusion),
                                                 .keyframes = parse_keyframes(keyframes),
                                                 .verify = verify,
                                                 .threshold = threshold,
                                                 .precision = precision,
                                                 .keep_clouds = keep_clouds,
                                                 .local_map = local_map});
          },
          nb::keep_alive<1, 2>(), "recognizer"_a, nb::kw_only(), "drive"_a = "",
          "exclusion"_a = to_string(Exclusion()), "keyframes"_a = "all", "verify"_a = nb::none(),
          "threshold"_a = nb::none(), "precision"_a = LoopDetectorOptions().precision,
          "keep_clouds"_a = true, "local_map"_a = 0,
          "drive: its name in the map.\n"
          "exclusion: recent scans that are not compared: 'frames=N', 'seconds=T', 'metres=L' or "
          "'none'.\n"
          "keyframes: scans that are stored; all are compared: 'all', 'metres=L' or "
          "'similarity=S'.\n"
          "verify: registers the places that look most alike, and accepts by how they fit, too. "
          "Default: where the feature tells the heading, as rings do, and points are kept. Without "
          "it the recogniser accepts.\n"
          "threshold: of registered loops: accepted from this similarity plus share of inliers on; "
          "None: from where the precision is reached.\n"
          "precision: the share of accepted registered loops that are to be right, as far as the "
          "calibration holds.\n"
          "keep_clouds: stores some 20 kB of points with each place, for registration.\n"
          "local_map: describes and registers what was seen on so many last metres, by the poses, "
          "instead of a scan alone; 0: not.")
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
          "Raises UsageError when the exclusion needs a time or a pose that is not given.")
      .def_prop_ro("drive", &LoopDetector::drive,
                   "The name of the recording in the map, after the first scan.")
      .def_prop_ro("verifies", &LoopDetector::verifies, "Whether accepted loops are registered.")
      .def_prop_ro("threshold", &LoopDetector::threshold, nb::call_guard<Unlocked>(),
                   "The score from which loops are accepted, or None.")
      .def_prop_ro(
          "highest_precision",
          [](const LoopDetector& self) -> std::optional<double> {
            const auto calibration = self.calibration();
            if (!calibration) return std::nullopt;
            return calibration->highest_precision();
          },
          nb::call_guard<Unlocked>(),
          "The highest precision that its calibration promises, or None without one.");
}

void bind_pose_files(nb::module_& module) {
  nb::class_<PoseGraphWriter>(module, "PoseGraphWriter",
                              "A pose graph in g2o's text format, written as it grows.")
      .def(nb::init<const fs::path&>(), "file"_a)
      .def(
          "vertex",
          [](PoseGraphWriter& self, int64_t id, PoseArgument pose) {
            self.vertex(id, pose_from(pose));
          },
          "id"_a, "pose"_a = nb::none(),
          "T_world_sensor, float64 [4][4]; an edge to the vertex before it when both have one.")
      .def(
          "known_vertex",
          [](PoseGraphWriter& self, int64_t id, PoseArgument pose) {
            self.known_vertex(id, pose_from(pose));
          },
          "id"_a, "pose"_a = nb::none(),
          "A vertex for a place of an earlier session, unless it is written already.")
      .def(
          "edge",
          [](PoseGraphWriter& self, int64_t place, int64_t query, const Registration& registered) {
            self.edge(place, query, registered.T_place_query, registered.information);
          },
          "place"_a, "query"_a, "registered"_a);
}

}  // namespace

void bind_maps(nb::module_& module) {
  bind_map_store(module);
  bind_records(module);
  bind_recognizer(module);
  bind_loop_detector(module);
  bind_pose_files(module);
}

}  // namespace revisit::python
