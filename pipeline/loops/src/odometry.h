#pragma once

#include <Eigen/Geometry>
#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <deque>
#include <memory>
#include <optional>
#include <utility>
#include <vector>

#include "revisit/registration/free_space.h"
#include "revisit/registration/registration.h"

namespace revisit {

/// A scan as registration and free space need it, which takes milliseconds and is therefore
/// computed when it is first needed. Copies share their data. Not thread-safe.
class SeenScan {
 public:
  SeenScan(PointCloud cloud, const RegistrationOptions& options)
      : parts_(std::make_shared<Parts>(Parts{std::move(cloud), options, {}, {}})) {}
  const PointCloud& cloud() const { return parts_->cloud; }
  const PreparedScan& prepared() const;
  const FreeSpace& space() const;

 private:
  struct Parts {
    PointCloud cloud;
    RegistrationOptions options;
    std::optional<PreparedScan> prepared;
    std::optional<FreeSpace> space;
  };
  std::shared_ptr<Parts> parts_;
};

/// The motion of a drive, by poses or by registration of consecutive scans. Poses are those of the
/// mounted frame.
class Odometry {
 public:
  explicit Odometry(const RegistrationOptions& options) : options_(options) {}

  /// The drive's next scan. If it or the reference has no pose, its motion is `step`, T_before_scan
  /// from the scan before, or else estimated by registration: from `relative_yaw` to the reference,
  /// absent: from the motion before.
  void arrive(const SeenScan& scan, int64_t frame,
              const std::optional<Eigen::Isometry3d>& T_world_scan,
              std::optional<double> relative_yaw,
              const std::optional<Eigen::Isometry3d>& step = std::nullopt);
  /// The scan of the last arrive() becomes the reference, unless it is of the same halt.
  void refer(int64_t index, const SeenScan& scan);

  /// The entry to which motions refer; absent at first.
  std::optional<int64_t> reference() const {
    return reference_ ? std::optional(reference_->index) : std::nullopt;
  }
  /// T_first_scan of the last scan, from the drive's first scan.
  const Eigen::Isometry3d& pose() const { return here_.pose; }
  /// No motion to that scan fits.
  bool is_lost() const { return is_lost_; }
  /// T_before_scan of that scan; absent: unknown, or along a corridor.
  std::optional<Eigen::Isometry3d> step() const {
    return here_.stretch == before_.stretch ? step_ : std::nullopt;
  }
  /// Path from the scan before to that scan [m]; absent: unknown. Negative within a halt.
  std::optional<double> motion() const {
    return step_ && is_known_ ? std::optional(here_.path - before_.path) : std::nullopt;
  }

 protected:
  struct Position {
    int64_t frame = 0;
    std::optional<Eigen::Isometry3d> given;                  // T_world_scan of the user
    Eigen::Isometry3d pose = Eigen::Isometry3d::Identity();  // in the drive, by its motions
    double path = 0;                                         // since its first scan [m]
    int64_t stretch = 0;  // between two of them the motion is unknown
  };
  struct Reference {
    int64_t index;
    Position at;
    SeenScan scan;
  };

  static constexpr size_t kRecent = 25;           // scans that tell what is usual
  static constexpr double kMinInlierRatio = 0.1;  // of consecutive scans that are registered

  bool is_moving() const;

  RegistrationOptions options_;
  Position here_, before_;  // of this scan and the one before
  std::optional<Reference> reference_;

 private:
  Eigen::Isometry3d motion_of(const SeenScan& scan, std::optional<double> relative_yaw,
                              const std::optional<Eigen::Isometry3d>& step);

  std::optional<Eigen::Isometry3d> step_;  // from one to the other; absent at first
  bool is_lost_ = false;                   // no motion fits
  bool is_known_ = false;                  // it is not contradicted either
  std::deque<double> inlier_ratios_;       // of consecutive scans
};

/// Yaw of T [rad].
double heading_of(const Eigen::Isometry3d& T);

template <class Value>
void push_recent(std::deque<Value>& values, Value value, size_t most) {
  values.push_back(std::move(value));
  if (values.size() > most) values.pop_front();
}

/// Of at least one value.
template <class Value>
double median(const std::deque<Value>& values) {
  std::vector<Value> sorted(values.begin(), values.end());
  std::ranges::sort(sorted);
  const size_t n = sorted.size();
  return (static_cast<double>(sorted[(n - 1) / 2]) + static_cast<double>(sorted[n / 2])) / 2;
}

}  // namespace revisit
