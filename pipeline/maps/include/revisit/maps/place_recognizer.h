#pragma once

#include <cstdint>
#include <map>
#include <memory>
#include <optional>
#include <set>
#include <span>
#include <string>
#include <vector>

#include "revisit/maps/map_store.h"
#include "revisit/recognition/feature.h"
#include "revisit/recognition/match.h"
#include "revisit/recognition/place_index.h"
#include "revisit/recognition/point_cloud.h"

namespace revisit {

struct RecognizerOptions {
  /// Transforms points of a scan to a frame with x forward, y left and z up (parse_mount()).
  Eigen::Isometry3d mount = Eigen::Isometry3d::Identity();
  AlignCase align = AlignCase::kNone;
  ImageGeometry geometry;  // for features computed from the range image
  /// Warm-up of a feature with trained parameters (for rings: the map mean). They are estimated
  /// from the first entries of which this many are distinct, at most five times as many entries,
  /// which are then described again.
  int64_t warmup = 128;
  /// Minimum score for acceptance. Absent: the threshold or calibration of the map, else the
  /// calibration of the feature.
  std::optional<double> threshold;
  /// Target precision of accepted matches (Calibration::threshold_for()).
  double target_precision = 0.95;
  int k = 4;
  /// Absent: the score that the feature was calibrated for. Without a calibration:
  /// Score::kDistinctMargin if similarities of the feature identify equal places, else
  /// Score::kMargin.
  std::optional<Score> score;
  /// For large maps of a feature compared by cosine: number of candidates, proposed by an HNSW
  /// graph, that are compared exactly (make_hnsw_source()). The graph is built when a map is
  /// opened, grows with it and is not stored. 0: exhaustive search.
  int64_t hnsw_candidates = 0;
  /// LoopDetectorOptions::local_map [m]; 0: single scans.
  double local_map = 0;
};

struct Description {
  std::vector<float> feature;  // empty if the scan could not be described
  std::string error;
  bool described() const { return !feature.empty(); }
};

struct Loop {
  int64_t index = 0;  // index in this PlaceRecognizer, from 0, in the order of loading or adding
  int64_t id = 0;     // this and the next four as in MapEntry
  std::string drive;
  int64_t frame = 0;
  std::optional<double> time;
  std::optional<Eigen::Isometry3d> pose;
  double similarity = 0;
  double kth_similarity = 0;  // k-th highest similarity, or that of the k-th distinct place
  double score = 0;           // kind: PlaceRecognizer::score()
  /// Probability that the match is correct; absent without a calibration for this score.
  std::optional<double> probability;
  std::optional<double> relative_yaw;  // yaw(query) - yaw(place), CCW [rad]
  /// The place lies where its drive looks alike for much longer than usual, as in a tunnel: its
  /// exact location is undetermined. Set only if similarities of the feature identify equal places.
  bool ambiguous = false;
  bool accepted = false;  // score >= threshold and not ambiguous; false without a threshold
};

/// With a map every entry is on the disk when add() returns. Thread-safe. All functions but query()
/// throw UsageError for an invalid index.
///
///   PlaceRecognizer recognizer(ring_recognizer(model, ring_net(model), {}), {});
///   const Description scan = recognizer.describe({points.data(), points.size(), sizeof(MyPoint)});
///   if (const auto loop = recognizer.query(scan, recent)) close_loop(*loop);
///   recognizer.add(scan, {.frame = 17, .pose = T_world_sensor});
class PlaceRecognizer {
 public:
  /// Loads the entries of `map`; null: a temporary file. Throws UsageError for a feature of camera
  /// images or invalid options, and InputError if the map's fingerprint differs; `map` then stays
  /// with the caller. `warn` gets a message for each corrupt entry, and if the warm-up cannot be
  /// completed. It also gets one for a calibration or threshold that is corrupt or for another
  /// score, which is then ignored.
  PlaceRecognizer(FeatureExtractor extractor, const RecognizerOptions& options,
                  std::unique_ptr<MapStore>&& map = nullptr, const MapStore::Warn& warn = {});
  ~PlaceRecognizer();

  static MapFingerprint fingerprint_of(const FeatureExtractor& extractor,
                                       const RecognizerOptions& options);
  /// RecognizerOptions::local_map [m]
  static double local_map_of(const MapFingerprint& fingerprint);

  Description describe(const PointsView& points) const;
  /// `about` has the drive, frame, time and pose. The index follows those of entries that other
  /// processes added before. Throws UsageError if the scan was not described, or by another
  /// feature, and what MapStore::add() throws; the scan is then not added to this object either.
  int64_t add(const Description& scan, MapEntry about);
  /// Adds several scans, or none, in one transaction. `claim` must contain their frames and ends
  /// with the call. Also completes a warm-up that a killed process left unfinished.
  void add(std::span<const Description> scans, std::vector<MapEntry> about, Claim* claim = nullptr);
  /// Best match, without the entries at the indices `exclude` (in any order), which are temporal
  /// neighbors. Empty if there is none or the scan was not described. Throws UsageError for a scan
  /// described by another feature.
  std::optional<Loop> query(const Description& scan, std::span<const int64_t> exclude = {}) const;

  /// Removes entries, also from the map (MapStore::remove()), and returns the number removed now.
  /// Other indices do not change.
  int64_t remove(std::span<const int64_t> indices);

  /// Number of indices in use: entries, including those removed since they were loaded.
  int64_t size() const;
  /// Includes drives whose entries were removed.
  std::set<std::string> drives() const;
  /// frame -> index of entries that were not removed
  std::map<int64_t, int64_t> entries_of(const std::string& drive) const;
  /// Indices of the consecutive entries of its drive that show the same place as the one at
  /// `index`, itself included; during a halt, the whole halt. Only `index` if similarities of the
  /// feature do not identify equal places.
  std::vector<int64_t> around(int64_t index) const;
  /// around() and the entries just before and after: a match may as well be one of these.
  std::vector<int64_t> near(int64_t index) const;
  /// MapStore::reserve_drive() of the map.
  bool reserve_drive(const std::string& drive, const std::string& content);
  /// MapEntry::cloud; "": none. Throws what MapStore::cloud() throws.
  std::string cloud(int64_t index) const;
  /// Throws UsageError for a scan that was not described by this feature.
  double similarity(const Description& scan, int64_t index) const;
  /// [s]; absent if unknown
  std::optional<double> time(int64_t index) const;
  const Eigen::Isometry3d& mount() const;
  double local_map() const;  // [m]
  bool has_map() const;
  bool is_warmed_up() const;
  bool estimates_yaw() const;
  /// Absent if the options and the map have none and no calibration reaches
  /// RecognizerOptions::target_precision.
  std::optional<double> threshold() const;
  Score score() const;
  /// Calibration of the map, else of the feature; absent if none fits the k and score options.
  std::optional<Calibration> calibration() const;
  /// For loops registered by LoopDetector; absent if the map has none.
  std::optional<Calibration> verified_calibration() const;
  /// True if the map has a threshold or calibration for query(), not for registered loops.
  bool is_calibrated() const;
  /// Loads entries that other processes added to the map and drops those they removed.
  void refresh();
  /// refresh() if MapStore::has_updates(); cheap otherwise.
  void refresh_if_updated();
  /// Stores a threshold or calibration in the map, replacing either. A calibration for
  /// Score::kVerified is stored separately. Throws UsageError for a threshold that is not finite,
  /// and for a calibration for another k or score, or without blocks.
  void calibrate(double threshold);
  void calibrate(const Calibration& calibration);

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

/// HNSW graph (FAISS) over half-precision descriptors of `index`, compared by cosine, for maps too
/// large for exhaustive search. Later entries are added to it. Built by `threads` threads; depends
/// on their number. Throws UsageError if the index is empty or has another comparison, or in a
/// build without FAISS.
std::unique_ptr<CandidateSource> make_hnsw_source(const PlaceIndex& index, int threads = 1);

}  // namespace revisit
