#pragma once

#include <Eigen/Geometry>
#include <cstdint>
#include <deque>
#include <map>
#include <optional>
#include <string>
#include <unordered_map>
#include <utility>
#include <vector>

#include "odometry.h"
#include "revisit/loops/loop_detector.h"

namespace revisit {

/// A map entry as a candidate of a loop. Poses are those of the mounted frame, with z up.
struct CandidatePlace {
  int64_t index;  // in the map
  std::string drive;
  std::optional<Eigen::Isometry3d> pose;  // T_world_place
  SeenScan scan;
  double path = 0;  // of its drive at the place, by poses [m]; only of other drives than the scan's
};

/// What the preceding scans of a drive tell about its next loop: the motion, what is usual, and the
/// loops accepted on the last meters. Poses are those of the mounted frame.
class DriveHistory : public Odometry {
 public:
  DriveHistory(const RegistrationOptions& options, const OdometryGate& gate)
      : Odometry(options), gate_(gate) {}

  /// Odometry::arrive()
  void arrive(const SeenScan& scan, int64_t frame,
              const std::optional<Eigen::Isometry3d>& T_world_scan,
              std::optional<double> relative_yaw,
              const std::optional<Eigen::Isometry3d>& step = std::nullopt);
  /// The scan of the last arrive() is the entry at `index`.
  void add(int64_t index, const SeenScan& scan);
  /// The loop of that scan to `place` is accepted, or only objection() prevents it. Returns the
  /// frames of accepted loops that it calls in question.
  std::vector<int64_t> take_loop(const CandidatePlace& place, const Eigen::Isometry3d& T_place_scan,
                                 bool accepted);

  /// That of a recent scan (scene_scale()).
  double scale() const { return scale_; }
  /// Usual contradiction between consecutive scans: traffic, leaves and noise. At first a low one
  /// for scenes of this scale.
  double level(double scale) const;
  /// Something near hides the scene from one of both.
  bool is_hidden(const SeenScan& scan, const SeenScan& place) const;
  bool is_of_drive(int64_t index) const { return entries_.contains(index); }
  /// The poses of both refute the loop: odometry does not drift that much. Of another drive: the
  /// poses and the loops that relate both drives.
  bool is_refuted(const CandidatePlace& place, const Eigen::Isometry3d& T_place_scan) const;
  /// So is every loop of at most `reach` [m] to this drive's entry. `by_poses`: it has a pose.
  bool is_out_of_reach(int64_t index, bool by_poses, double reach) const;
  /// Rejection of a loop that is accepted otherwise: "odometry", "inconsistent" or "".
  std::string objection(const CandidatePlace& place, const Eigen::Isometry3d& T_place_scan) const;
  /// Index of the place of a loop accepted on the last 10 m.
  std::optional<int64_t> last_place() const;
  /// yaw(scan) - yaw(entry) by that loop and the motion since [rad]; absent for other drives.
  std::optional<double> yaw_to(int64_t index) const;
  /// Both loops of a scan give the same pose. Its error grows with `path` [m]. `whole`: also in
  /// tilt.
  bool are_one(const CandidatePlace& place, const Eigen::Isometry3d& T_place_scan,
               const CandidatePlace& other, const Eigen::Isometry3d& T_other_scan, double path = 0,
               bool whole = false) const;
  /// The pose agrees with a loop accepted on the last 10 m.
  bool confirms(const CandidatePlace& place, const Eigen::Isometry3d& T_place_scan) const;

 private:
  struct AcceptedLoop {
    CandidatePlace place;
    Eigen::Isometry3d T_place_scan;
    Position at;
  };

  /// A loop, or several agreeing ones of a halt.
  struct FittingLoop {
    int64_t index;  // of the place, and the next three
    std::string drive;
    std::optional<Eigen::Isometry3d> pose;
    double path;
    Eigen::Isometry3d T_place_scan;
    Position at;
    std::vector<int64_t> frames = {};     // accepted, and not called in question
    int agreeing = 0, contradicting = 0;  // of the loops on 30 m before and behind

    void count(bool agrees) { ++(agrees ? agreeing : contradicting); }
    bool is_outvoted() const { return contradicting >= agreeing + 2; }
  };

  /// What relates the worlds of both drives' poses.
  struct Relation {
    FittingLoop loop, refuted;          // the last ones that agree with others
    std::vector<int64_t> frames = {};   // of accepted loops
    int n_accepted = 0, n_refuted = 0;  // refuted: since then, and all agree
  };

  FittingLoop fitting(const CandidatePlace& place, const Eigen::Isometry3d& T_place_scan) const {
    return {place.index, place.drive, place.pose, place.path, T_place_scan, here_};
  }
  bool is_beyond(const Eigen::Vector3d& apart, const Eigen::Vector3d& up, double path,
                 double reach) const;
  bool is_refuted_by_motion(const Position& place, const Eigen::Vector3d& apart,
                            double reach) const;
  /// Absent: unknown.
  std::optional<bool> agree(const FittingLoop& one, const FittingLoop& before) const;
  std::vector<int64_t> relate(const FittingLoop& loop, bool accepted);
  void sample(const SeenScan& scan);
  std::optional<Eigen::Isometry3d> between(const CandidatePlace& to, const CandidatePlace& from,
                                           const Eigen::Isometry3d& expected) const;

  OdometryGate gate_;
  int64_t moved_ = 0;  // number of scans that are no halt
  double scale_ = 1;
  std::deque<double> contradictions_;              // of sampled scans in the keyframes before
  std::deque<int64_t> upright_;                    // of sampled scans: numbers of upright points
  std::deque<AcceptedLoop> accepted_;              // of the last meters
  std::deque<FittingLoop> fitting_;                // of the last 30 m
  std::map<std::string, Relation> related_;        // other drive -> its relation to this one
  std::unordered_map<int64_t, Position> entries_;  // index -> position, of this drive
};

}  // namespace revisit
