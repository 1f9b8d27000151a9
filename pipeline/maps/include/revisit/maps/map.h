#pragma once

#include <Eigen/Geometry>
#include <cstdint>
#include <filesystem>
#include <functional>
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

/// Settings of a Map.
struct MapOptions {
  /// Sensor of a shipped ring model. "" or "auto": that of the map, else choose_ring_model()
  /// decides by the first scan with at least 500 returns; scans before it are not described. Local
  /// maps of any sensor have hdl64 (docs/SLAM.md).
  std::string sensor;
  MapAccess access = MapAccess::kWrite;  ///< to the file
  int threads = 1;                       ///< to describe a scan
  /// Transforms points of a scan to a frame with x forward, y left and z up (parse_mount()).
  Eigen::Isometry3d mount = Eigen::Isometry3d::Identity();
  /// LoopDetector describes and registers the points of the last meters, accumulated by the scans'
  /// poses, instead of single scans [m]; 0: off. For sensors with a gap in azimuth or with few
  /// points. All sessions of a map have the same.
  double local_map = 0;
  /// Warm-up of a feature with trained parameters (for rings: the map mean). They are estimated
  /// from the first entries of which this many are distinct, at most five times as many entries,
  /// which are then described again.
  int64_t warmup = 128;
  int k = 4;  ///< rank of the similarity that a margin score compares with
  /// Absent: the score that the feature was calibrated for. Without a calibration:
  /// Score::kDistinctMargin if similarities of the feature identify equal places, else
  /// Score::kMargin.
  std::optional<Score> score;
  /// For large maps of a feature compared by cosine: number of candidates, proposed by an HNSW
  /// graph, that are compared exactly (make_hnsw_source()). The graph is built when a map is
  /// opened, grows with it and is not stored. 0: exhaustive search.
  int64_t hnsw_candidates = 0;
  AlignCase align = AlignCase::kNone;  ///< this and `geometry`: of features of range images
  ImageGeometry geometry;              ///< see `align`
};

/// The feature of a scan, as Map::query() and Map::add() take it.
struct Description {
  std::vector<float> feature;  ///< empty if the scan could not be described
  std::string error;           ///< why the scan could not be described; else ""
  std::string made_by;         ///< FeatureExtractor::key; "": any feature of these dimensions
  bool described() const { return !feature.empty(); }  ///< else see `error`
};

/// A map entry as the match of a query.
struct Loop {
  int64_t index = 0;           ///< index in this Map, from 0, in the order of loading or adding
  int64_t id = 0;              ///< this and the next four as in MapEntry
  std::string drive;           ///< of the entry
  int64_t frame = 0;           ///< of the entry
  std::optional<double> time;  ///< [s]
  std::optional<Eigen::Isometry3d> pose;  ///< T_world_sensor of the entry [m]
  double similarity = 0;      ///< of the query and the entry, at most 1 for cosines and rings
  double kth_similarity = 0;  ///< k-th highest similarity, or that of the k-th distinct place
  double score = 0;           ///< kind: MapOptions::score, or LoopDetector::score()
  /// Probability that the match is correct, by LoopDetector; absent without a calibration.
  std::optional<double> probability;
  std::optional<double> relative_yaw;  ///< yaw(query) - yaw(place), CCW [rad]
  /// The place lies where its drive looks alike for much longer than usual, as in a tunnel: its
  /// exact location is undetermined. Set only if similarities of the feature identify equal places.
  bool ambiguous = false;
};

/// frame -> index of the entry
using DriveEntries = std::map<int64_t, int64_t>;

/// Entries of a map in memory and on the disk: with a file, every entry is there when add()
/// returns. Thread-safe. Functions throw UsageError for an invalid index.
///
///   Map map("site.map");
///   const Description scan = map.describe({points.data(), points.size(), sizeof(MyPoint)});
///   if (const auto loop = map.query(scan, recent)) ...
///   map.add({{.frame = 17, .pose = T_world_sensor, .feature = scan.feature}});
class Map {
 public:
  /// A map of ring descriptors, created if missing; "": a temporary file. If the sensor is not
  /// known yet, the file is opened by the first describe(). Throws what open_map() throws,
  /// UsageError for invalid options, and InputError for a map of another feature than a shipped
  /// ring model. `warn` gets a message for the sensor that was found, for each corrupt entry, and
  /// if the warm-up cannot be completed; it must not call this object. Absent: standard error.
  explicit Map(const std::filesystem::path& file, const MapOptions& options = {},
               const MapStore::Warn& warn = {});
  /// Any feature of scans. Loads the entries of `map`; null: a temporary file. Throws UsageError
  /// for a feature of camera images or invalid options, and InputError if the map's fingerprint
  /// differs; `map` then stays with the caller.
  Map(FeatureExtractor extractor, const MapOptions& options,
      std::unique_ptr<MapStore>&& map = nullptr, const MapStore::Warn& warn = {});
  ~Map();

  Description describe(const PointsView& points) const;  ///< a failure is in Description::error
  /// Adds entries, or none, in one transaction and returns their indices, which follow those of
  /// entries that other processes added before. Each needs MapEntry::feature, of describe(). Also
  /// completes a warm-up that a killed process left unfinished. `made_by`: Description::made_by of
  /// the features. Throws UsageError for another feature, and what MapStore::add() throws; the
  /// entries are then not added to this object either.
  std::vector<int64_t> add(std::vector<MapEntry> entries, const std::string& made_by = "");
  /// Removes entries, also from the file (MapStore::remove()), and returns the number removed now.
  /// Other indices do not change.
  int64_t remove(std::span<const int64_t> indices);
  /// Loads entries that other processes added and drops those they removed. Returns the number of
  /// loadings so far; takes microseconds if nothing changed.
  int64_t refresh();

  /// Best match, without the entries at the indices `exclude` (in any order), which are temporal
  /// neighbors. Empty if there is none or the scan was not described. Throws UsageError for another
  /// feature.
  std::optional<Loop> query(const Description& scan, std::span<const int64_t> exclude = {}) const;
  /// Throws UsageError for another feature.
  double similarity(const Description& scan, int64_t index) const;
  /// The entry as a match, whose scores are the similarity. Throws UsageError for another feature.
  Loop compare(const Description& scan, int64_t index) const;

  /// Number of indices in use: entries, including those removed since they were loaded.
  int64_t size() const;
  /// Number of entries that do not look like the preceding one of their drive.
  int64_t distinct() const;
  bool is_warmed_up() const;  ///< the descriptor projection is fixed
  /// Without descriptor, feature and cloud.
  MapEntry entry(int64_t index) const;
  /// Entries that were not removed.
  DriveEntries entries_of(const std::string& drive) const;
  /// Includes drives whose entries were removed.
  std::set<std::string> drives() const;
  /// Indices of the consecutive entries of its drive that show the same place as the one at
  /// `index`, itself included; during a halt, the whole halt. Only `index` if similarities of the
  /// feature do not identify equal places. `margin`: and the entries just before and after, which
  /// a match may as well be.
  std::vector<int64_t> around(int64_t index, bool margin = false) const;

  /// Calls `work` while no other function uses the file. Throws what `work` throws.
  void use_store(const std::function<void(MapStore&)>& work) const;
  /// With the score in use and, as soon as it is known, the sensor.
  MapOptions options() const;
  /// Null until the sensor is known. Valid as long as this object.
  const FeatureExtractor* extractor() const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

/// Candidates of ring descriptors by compact codes. They include every correct best match of an
/// exhaustive comparison and all of the four best, which make the score, in maps of up to a million
/// entries (docs/reference/SPEED.md).
inline constexpr int64_t kRingCandidates = 1000;

/// `warn`, or a function that prints to standard error if it is empty.
MapStore::Warn or_standard_error(const MapStore::Warn& warn);

/// Settings that define the descriptors of a new map.
MapFingerprint fingerprint_of(const FeatureExtractor& extractor, const MapOptions& options);
/// MapOptions::local_map [m]
double local_map_of(const MapFingerprint& fingerprint);

}  // namespace revisit
