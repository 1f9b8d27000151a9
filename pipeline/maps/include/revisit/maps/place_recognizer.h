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
#include "revisit/recognition/points.h"

namespace revisit::pipeline {

struct RecognizerOptions {
  /// Takes points of a scan to a frame with x forward, y left and z up (parse_mount()).
  Eigen::Isometry3d mount = Eigen::Isometry3d::Identity();
  AlignCase align = AlignCase::kNone;
  ImageGeometry geometry;  // of a feature that sees the range image
  /// A feature that learns from the map's scans (rings their mean) does so from the first places
  /// until so many of them are distinct, at most from five times as many, and describes them
  /// again; what comes later is described as these are.
  int64_t first_stretch = 128;
  /// Of the score: at least so much is accepted. Absent: what the map was calibrated to; in a map
  /// that was not, what the feature was.
  std::optional<double> threshold;
  /// Of what is accepted, this share is right, as far as the calibration of the map or of the
  /// feature holds (Calibration::threshold_for()).
  double precision = 0.95;
  int k = 4;
  /// Absent: what the feature was calibrated for; for one that was not Score::kDistinctMargin where
  /// its similarities tell which places are one, else Score::kMargin.
  std::optional<Score> score;
  /// Of large maps of a feature compared by cosine: this many places, proposed by a graph, are
  /// compared (large_maps.h). The graph is made when a map is opened, grows with it and is not
  /// kept. 0: no graph.
  int64_t graph_candidates = 0;
  /// The scans are LoopDetectorOptions::local_map [m].
  double local_map = 0;
};

/// What a scan looks like.
struct Description {
  std::vector<float> feature;  // empty for a scan that could not be described ...
  std::string why_not;         // ... for this reason
  bool described() const { return !feature.empty(); }
};

/// A place that looks like the scan asked.
struct Loop {
  int64_t position = 0;  // of the place in this recogniser, counted from 0 as it came to know them
  int64_t id = 0;        // of the place in the map, as below: StoredPlace
  std::string drive;
  int64_t frame = 0;
  std::optional<double> time;
  std::optional<Eigen::Isometry3d> pose;
  double similarity = 0;  // of the descriptors
  double runner_up = 0;   // the similarity of the k-th best, or k-th distinct one
  double score = 0;       // PlaceRecognizer::score()
  /// That the place is right; absent without a calibration for this score.
  std::optional<double> probability;
  std::optional<double> turn;  // heading of the scan less heading of the place, ccw [rad]
  /// The place lies where its drive looks the same for much longer than usual, as in a tunnel:
  /// which place of that it is cannot be told. Known where similarities tell which places are one.
  bool ambiguous = false;
  bool accepted = false;  // the score reaches the threshold, and not ambiguous; false without one
};

/// Knows places and recognises them, one scan at a time. With a map every place is on the disk when
/// add() returns. Any number of threads may call.
///
///   PlaceRecognizer recognizer(ring_recogniser(model, ring_net(model), {}), {});
///   const Description scan = recognizer.describe({points.data(), points.size(), sizeof(MyPoint)});
///   if (const auto loop = recognizer.query(scan, recent)) close_loop(*loop);
///   recognizer.add(scan, {.frame = 17, .pose = T_world_sensor});
class PlaceRecognizer {
 public:
  /// The places of `map` are known at once; null: nothing is kept. Throws UsageError for a feature
  /// of camera images or invalid options, InputError when the map was made with another
  /// feature (identity_of()); `map` then stays with the caller. `damaged` gets a message for each
  /// place that cannot be read, and when the first stretch cannot be ended, and one when the map
  /// was calibrated for another score, or keeps a calibration or threshold that is damaged: such
  /// are left aside.
  PlaceRecognizer(FeatureExtractor extractor, const RecognizerOptions& options,
                  std::unique_ptr<MapStore>&& map = nullptr, const MapStore::Damaged& damaged = {});
  ~PlaceRecognizer();

  /// What a map that this feature and these options fill must have been made with.
  static MapIdentity identity_of(const FeatureExtractor& extractor,
                                 const RecognizerOptions& options);
  /// `RecognizerOptions::local_map` [m] of a map with this identity.
  static double local_map_of(const MapIdentity& identity);

  Description describe(const PointsView& points) const;
  /// `about`: drive, frame, time and pose; returns the position, which others' places precede when
  /// they were added to the map before it. Throws UsageError for a scan that was not described, or
  /// by another feature, and what MapStore::add() throws: the place is then not known either.
  int64_t add(const Description& scan, StoredPlace about);
  /// Adds several scans, or none, in one step. `claim` has their frames and ends with the call.
  /// Ends a first stretch in which a process was killed.
  void add(std::span<const Description> scans, std::vector<StoredPlace> about,
           Claim* claim = nullptr);
  /// The best place but those at the positions `without` (in any order), which are of the same
  /// moment; nothing when there is none or the scan was not described. Throws UsageError for a scan
  /// that another feature described.
  std::optional<Loop> query(const Description& scan, std::span<const int64_t> without = {}) const;

  /// Removes the places at these positions, from the map, too (MapStore::remove()). Returns how
  /// many had not been removed. No query answers with them; the others keep their positions. Throws
  /// UsageError for a position without a place.
  int64_t remove(std::span<const int64_t> positions);

  /// Places known, with those removed since this object knows them: the next one's position.
  int64_t size() const;
  /// The names of drives that have places, with those whose places were removed.
  std::set<std::string> drives() const;
  /// The places of a drive that were not removed: frame -> position.
  std::map<int64_t, int64_t> places_of(const std::string& drive) const;
  /// The positions of the places of its drive that look alike from before to behind the one at
  /// `position`, with it: during a halt all of the halt. Only that one where similarities do not
  /// tell which places are one. Throws UsageError for a position without a place.
  std::vector<int64_t> around(int64_t position) const;
  /// The same with what its drive saw just before and behind: a query that looks like the one at
  /// `position` may as well have been taken there.
  std::vector<int64_t> near(int64_t position) const;
  /// MapStore::reserve_drive() of the map; true without one.
  bool reserve_drive(const std::string& drive, const std::string& content);
  /// The points of the place at `position` (StoredPlace::cloud); "": none. Throws UsageError for a
  /// position without a place, and what MapStore::cloud() throws.
  std::string cloud(int64_t position) const;
  /// Of a scan to the place at `position`. Throws UsageError for a position without a place and for
  /// a scan that was not described by this feature.
  double similarity(const Description& scan, int64_t position) const;
  /// When the scan of the place was taken [s]; absent: unknown. Throws UsageError for a position
  /// without a place.
  std::optional<double> time(int64_t position) const;
  const Eigen::Isometry3d& mount() const;
  double local_map() const;  // RecognizerOptions::local_map
  bool has_map() const;
  /// Whether the feature has learnt from the first stretch of places.
  bool has_learnt() const;
  /// Whether queries say how the scan is turned against the place (Loop::turn).
  bool finds_heading() const;
  /// The score from which places are accepted; absent when neither the options, nor the map, nor a
  /// calibration that promises RecognizerOptions::precision give one.
  std::optional<double> threshold() const;
  /// How sure matches are: RecognizerOptions::score, or what stands for it.
  Score score() const;
  /// The map's, or else the feature's; absent when none is for the k and score of the options.
  std::optional<Calibration> calibration() const;
  /// The map's, of loops that LoopDetector has registered; absent when it has none.
  std::optional<Calibration> verified_calibration() const;
  /// Whether the map keeps a threshold or a calibration of query(), which say nothing of loops that
  /// LoopDetector has registered.
  bool is_calibrated() const;
  /// Takes in what others have added to the map, and out what they have removed.
  void refresh();
  /// The same when the map says that there is something (MapStore::has_news()): cheap when not.
  void refresh_on_news();
  /// Keeps a threshold or a calibration in the map, in the place of either. Throws UsageError for a
  /// threshold that is not finite, and for a calibration of another k or score, or without blocks.
  /// One of Score::kVerified is kept beside these.
  void calibrate(double threshold);
  void calibrate(const Calibration& calibration);

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace revisit::pipeline
