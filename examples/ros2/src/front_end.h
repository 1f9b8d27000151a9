// Loop closure of a robot, without ROS: points of messages, poses of scans, detection. Stamps are
// nanoseconds.
#pragma once

#include <revisit/base/error.h>
#include <revisit/base/text.h>
#include <revisit/datasets/scan_file.h>
#include <revisit/loops/loop_detector.h>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <map>

namespace revisit::ros {

inline double seconds(int64_t nanoseconds) {
  return 1e-9 * static_cast<double>(nanoseconds);
}

struct StampedScan {
  int64_t stamp = 0;
  PointCloud cloud;
  RecordedTimes times;  // of the points
};

enum : uint8_t { kInt32 = 5, kUint32, kFloat32, kFloat64 };  // sensor_msgs/PointField

/// Throws UsageError unless it has x, y and z, float32 or float64, and the bytes of its header.
template <class PointCloud2>
StampedScan scan_of(const PointCloud2& m, int64_t stamp) {
  const auto find = [&](const std::string& name) {
    for (const auto& field : m.fields)
      if (field.name == name && field.datatype >= kInt32 && field.datatype <= kFloat64 &&
          field.offset + (field.datatype == kFloat64 ? 8 : 4) <= m.point_step)
        return &field;
    return decltype(&m.fields[0])();
  };
  const auto *x = find("x"), *y = find("y"), *z = find("z");
  if (!x || !y || !z || x->datatype < kFloat32 || y->datatype != x->datatype ||
      z->datatype != x->datatype || m.is_bigendian)
    throw UsageError("points: expected little-endian fields x, y, z, float32 or float64");
  StampedScan scan{.stamp = stamp};
  const size_t bytes = size_t{m.width} * m.point_step;
  if (bytes == 0 || m.height == 0) return scan;
  // Rows may be padded. Some drivers leave the step 0.
  const size_t step = m.height > 1 && m.row_step > 0 ? m.row_step : bytes;
  if (bytes > step || m.data.size() < bytes || (m.data.size() - bytes) / step + 1 < m.height)
    throw UsageError("points: the message is shorter than its header states");
  decltype(x) time = nullptr, nanoseconds = find("timestampNsec");
  for (const char* name : kPointTimeNames)
    if (!time && (name != std::string("timestampSec") || nanoseconds)) time = find(name);
  if (time) scan.times = {.field = time->name, .values = {}, .stamp = seconds(stamp)};
  const auto number = [&](const auto* field, const uint8_t* point) {
    const auto as = [&](auto value) {
      std::memcpy(&value, point + field->offset, sizeof value);
      return static_cast<double>(value);
    };
    return field->datatype == kFloat64   ? as(double{})
           : field->datatype == kFloat32 ? as(float{})
           : field->datatype == kUint32  ? as(uint32_t{})
                                         : as(int32_t{});
  };
  PointCloud part;
  for (size_t i = 0; i < m.height; ++i) {
    const uint8_t* row = m.data.data() + i * step;
    copy_points(
        {row, m.width, m.point_step, x->offset, y->offset, z->offset, x->datatype == kFloat64},
        part);
    scan.cloud.points.insert(scan.cloud.points.end(), part.points.begin(), part.points.end());
    for (size_t k = 0; time && k < m.width; ++k) {
      const uint8_t* point = row + k * m.point_step;
      scan.times.values.push_back(scan.times.field == "timestampSec"
                                      ? 1e9 * number(time, point) + number(nanoseconds, point)
                                      : number(time, point));
    }
  }
  return scan;
}

/// Of a livox_ros_driver2/CustomMsg.
template <class CustomMsg>
StampedScan livox_scan_of(const CustomMsg& m, int64_t stamp) {
  StampedScan scan{.stamp = stamp, .cloud = {}, .times = {"offset_time", {}, seconds(stamp)}};
  for (const auto& p : m.points) {
    scan.cloud.points.push_back({p.x, p.y, p.z, static_cast<float>(p.reflectivity)});
    scan.times.values.push_back(p.offset_time);
  }
  return scan;
}

/// Poses of the last 10 s of odometry, and those between two at most a second apart.
class PoseTrack {
 public:
  void add(int64_t stamp, const Eigen::Isometry3d& T_world_body) {
    constexpr int64_t kKept = 10'000'000'000;
    if (!poses_.empty() && stamp < poses_.rbegin()->first - kKept) poses_.clear();  // other clock
    poses_[stamp] = T_world_body;
    poses_.erase(poses_.begin(), poses_.lower_bound(poses_.rbegin()->first - kKept));
  }
  std::optional<Eigen::Isometry3d> at(int64_t stamp) const {
    const auto after = poses_.lower_bound(stamp);
    if (after != poses_.end() && after->first == stamp) return after->second;
    if (after == poses_.end() || after == poses_.begin()) return std::nullopt;
    const auto& [first, from] = *std::prev(after);
    const double gap = seconds(after->first - first);
    if (gap > 1) return std::nullopt;
    return from * constant_velocity(from.inverse() * after->second, gap)(seconds(stamp - first));
  }

 private:
  std::map<int64_t, Eigen::Isometry3d> poses_;
};

/// Stamp of an entry: its frame, if FrontEnd stored it, else by its time; 0: unknown.
inline int64_t stamp_of(const Loop& loop) {
  if (!loop.time) return 0;
  constexpr double kSame = 1e-3;  // [s]; a time has fewer digits
  const bool is_stamp = std::abs(seconds(loop.frame) - *loop.time) < kSame;
  return is_stamp ? loop.frame : std::llround(*loop.time * 1e9);
}

/// Covariance of translation [m] and rotation about fixed axes [rad] in the axes of the place's
/// sensor, which is the convention of ROS.
inline Eigen::Matrix<double, 6, 6> covariance_of(const Registration& registered) {
  Eigen::Matrix<double, 6, 6> turn = Eigen::Matrix<double, 6, 6>::Zero();
  turn.topLeftCorner<3, 3>() = turn.bottomRightCorner<3, 3>() = registered.T_place_query.rotation();
  return turn * registered.information.inverse() * turn.transpose();
}

/// Scans wait for their poses, are deskewed and go to the detector.
class FrontEnd {
 public:
  using PoseOf = std::function<std::optional<Eigen::Isometry3d>(int64_t stamp)>;
  struct Result {
    int64_t stamp = 0;
    std::optional<Eigen::Isometry3d> pose;  // T_world_sensor
    std::string warning;                    // "": all is well
    Detection found;
  };
  /// `patience`: scans wait so long [s], then are taken without a pose. Absent: there are no poses.
  FrontEnd(Map& map, const LoopDetectorOptions& options, std::optional<double> patience)
      : detector_(map, options), patience_(patience) {}

  /// Throws UsageError unless the stamp is above that of the scan before.
  void add(StampedScan scan) {
    if (last_ && scan.stamp <= *last_)
      throw UsageError("a scan of ", scan.stamp, " ns comes after one of ", *last_,
                       " ns and is dropped; if the clock was set back, start the node again");
    last_ = scan.stamp;
    waiting_.push_back(std::move(scan));
  }

  /// Takes the scans whose poses are known, in order.
  void process(const PoseOf& pose_of, const std::function<void(const Result&)>& use) {
    while (!waiting_.empty()) {
      Result result{.stamp = waiting_.front().stamp};
      if (patience_) result.pose = pose_of(result.stamp);
      if (patience_ && !result.pose) {
        if (seconds(*last_ - result.stamp) <= *patience_) return;
        result.warning = str("a scan has no pose after ", *patience_, " s; is it published?");
      }
      StampedScan scan = std::move(waiting_.front());
      waiting_.pop_front();
      take(scan, result);
      use(result);
    }
  }

  LoopDetector& detector() { return detector_; }
  /// By the first three scans.
  const PointTimes& point_times() const { return point_times_; }

 private:
  void take(StampedScan& scan, Result& result) {
    const std::optional<Eigen::Isometry3d>& pose = result.pose;
    constexpr size_t kDeciding = 3;
    if (recorded_.size() < kDeciding && !scan.times.field.empty()) {
      recorded_.push_back(scan.times);
      point_times_ = point_times_of(recorded_);
    }
    if (!scan.times.field.empty()) set_times(scan.times, point_times_, scan.cloud);
    if (pose && before_)
      deskew(before_->second.inverse() * *pose, seconds(scan.stamp - before_->first), scan.cloud);
    if (pose) before_ = {scan.stamp, *pose};
    try {
      result.found = detector_.take(view_of(scan.cloud), {scan.stamp, seconds(scan.stamp), pose});
    } catch (const UsageError& error) {  // the next scan may be valid
      result.found.error = error.what();
    }
    if (!result.found.error.empty()) result.warning = result.found.error;
  }

  LoopDetector detector_;
  const std::optional<double> patience_;
  std::deque<StampedScan> waiting_;
  std::vector<RecordedTimes> recorded_;
  PointTimes point_times_;
  std::optional<int64_t> last_;                                  // stamp of the last scan added
  std::optional<std::pair<int64_t, Eigen::Isometry3d>> before_;  // last scan with a pose
};

}  // namespace revisit::ros
