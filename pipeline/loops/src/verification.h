#pragma once

#include <Eigen/Geometry>
#include <deque>
#include <map>
#include <optional>
#include <set>
#include <string>
#include <vector>

#include "acceptance.h"
#include "drive_history.h"
#include "revisit/loops/loop_detector.h"

namespace revisit {

/// Registers the most similar entries of a map and judges them by free space, by the scans before
/// and by poses. Keeps references to its arguments.
class Verification {
 public:
  Verification(const Map& map, const LoopDetectorOptions& options, const Acceptance& acceptance)
      : map_(map),
        options_(options),
        acceptance_(acceptance),
        history_(options.registration, options.odometry_gate.value_or(OdometryGate())),
        alone_(options.registration, OdometryGate()) {}

  /// The drive's next scan. `step`: Odometry::arrive().
  void arrive(const Description& scan, const SeenScan& seen, const ScanStamp& stamp,
              const std::optional<Eigen::Isometry3d>& step);
  const Odometry& odometry() const { return history_; }
  /// The scan of the last arrive() is the entry at `index`.
  void add(int64_t index, const SeenScan& seen) { history_.add(index, seen); }
  /// Chooses among the entry of `found` and up to two other places. The scan is that of the last
  /// arrive().
  void verify(const Description& scan, const SeenScan& seen, Detection& found);
  /// Up to three places of a scan without a drive, the best one first.
  std::vector<Detection> locate(const Description& scan, const SeenScan& seen,
                                const Loop& first) const;
  /// That of a recent scan (scene_scale()).
  double scale() const { return history_.scale(); }

 private:
  struct Candidate {
    Loop loop;
    std::optional<CandidatePlace> place = {};                         // if it fits
    Eigen::Isometry3d T_place_query = Eigen::Isometry3d::Identity();  // of mounted points
    std::optional<Registration> registered = {};                      // in the sensors' frames
    std::string rejection = {};
    bool fits = false;  // it is accepted, or would be without DriveHistory::objection()
  };

  struct PreparedEntry {
    int64_t id;
    Eigen::Isometry3d mount;
    SeenScan scan;
  };

  static double score_of(const Loop& loop, const DriveHistory& history, double scale,
                         double contradiction);
  static double unknown_score(const Loop& loop, const DriveHistory& history);
  static bool is_better(const Candidate& one, const Candidate& other);
  std::vector<Candidate> try_places(const Description& scan, const SeenScan& seen,
                                    const std::optional<Loop>& first, std::vector<int64_t> excluded,
                                    const DriveHistory& history) const;
  bool are_one(const Candidate& one, const Candidate& other) const;
  std::vector<int64_t> same_place(const Loop& loop) const;
  std::optional<Loop> followed(const Description& scan, const std::vector<int64_t>& excluded) const;
  bool is_ambiguous(const Candidate& candidate, const std::vector<Candidate>& tried) const;
  void reject(Candidate& candidate, const DriveHistory& history, const std::string& why) const;
  Candidate candidate_of(const Loop& loop, const SeenScan& query,
                         const DriveHistory& history) const;
  std::optional<PreparedEntry> prepared_entry(int64_t id) const;
  std::string register_entry(const SeenScan& query, const DriveHistory& history,
                             Candidate& candidate) const;
  std::string judge(const SeenScan& query, const DriveHistory& history, Candidate& candidate) const;
  double path_of(const Loop& loop) const;

  const Map& map_;
  const LoopDetectorOptions& options_;
  const Acceptance& acceptance_;
  DriveHistory history_;
  const DriveHistory alone_;           // of a scan without a drive
  mutable std::set<int64_t> corrupt_;  // ids of entries whose points were reported
  mutable std::map<std::string, std::map<int64_t, double>> paths_;  // drive -> index -> path [m]
  mutable std::deque<PreparedEntry> recent_;                        // the last one first
};

}  // namespace revisit
