#pragma once

#include <Eigen/Geometry>
#include <cstdint>
#include <functional>
#include <iterator>
#include <map>
#include <optional>
#include <queue>
#include <span>
#include <string>
#include <vector>

#include "revisit/recognition/place_index.h"

namespace revisit {

/// An entry of a PlaceIndex as a scan of a drive.
struct DriveScan {
  std::string drive;                      ///< recording that it is from
  int64_t frame = 0;                      ///< ascends in the drive
  std::optional<Eigen::Isometry3d> pose;  ///< T_world_sensor [m]
};

/// Median of the numbers so far.
class RunningMedian {
 public:
  void add(double number);                                            ///< takes O(log n)
  double value() const { return lower_.empty() ? 0 : lower_.top(); }  ///< 0 if empty

 private:
  std::priority_queue<double> lower_;  ///< same size as upper_, or one more
  std::priority_queue<double, std::vector<double>, std::greater<>> upper_;
};

/// Finds self-similar parts of a drive, as in a tunnel, where places cannot be distinguished. A
/// drive is divided into stretches: an entry belongs to the stretch while it looks like the first
/// entry of the stretch (Comparison::same_place), else it begins the next one. The length of a
/// stretch is measured from its first entry to the next stretch, in changes of the view and, with
/// poses, in meters; both must be long. Halts are therefore short, and neither speed nor density of
/// the entries matters.
class Stretches {
 public:
  /// `same_place`: Comparison::same_place.
  explicit Stretches(double same_place) : same_place_(same_place) {}

  /// Adds the entries of `index` from size() on. Those of a drive count in the order of their
  /// frames, also if several processes added them.
  void add(std::span<const DriveScan> scans, const PlaceIndex& index);
  int64_t size() const { return std::ssize(of_entry_); }  ///< entries added
  bool is_long(int64_t entry) const;                      ///< its stretch is much longer than usual
  /// Entries of its stretch, ascending; empty for an entry that was not added yet.
  std::span<const int64_t> around(int64_t entry) const;
  std::vector<int64_t> near(int64_t entry) const;           ///< of its stretch and those beside it
  int64_t count() const { return std::ssize(stretches_); }  ///< stretches

 private:
  static constexpr double kLong = 5;
  /// The view counts as changed below this similarity. Scans of a halt are far more similar.
  static constexpr double kSameView = 0.95;
  struct Stretch {
    int64_t first, view;  ///< first entry, and last entry that changed the view
    std::optional<Eigen::Isometry3d>
        pose;  ///< of the first entry; absent if any of the others has none
    double meters = 0;
    double views = 0;
    std::vector<int64_t> entries;
    std::optional<int64_t> before, behind;
  };
  const Stretch& stretch_of(int64_t entry) const {
    return stretches_[static_cast<size_t>(of_entry_[static_cast<size_t>(entry)])];
  }
  void add(int64_t entry, const DriveScan& scan, const PlaceIndex& index);

  double same_place_;
  std::vector<Stretch> stretches_;
  std::vector<int64_t> of_entry_;
  std::map<std::string, int64_t> current_;
  RunningMedian meters_, views_;  ///< lengths of all but the last stretch of each drive
};

}  // namespace revisit
