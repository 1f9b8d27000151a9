#pragma once

#include <cstdint>
#include <functional>
#include <iterator>
#include <map>
#include <optional>
#include <queue>
#include <span>
#include <string>
#include <vector>

#include "revisit/maps/map_store.h"
#include "revisit/recognition/place_index.h"

namespace revisit::pipeline {

/// The middle of numbers that come one by one.
class RunningMedian {
 public:
  void add(double number);
  /// 0 without numbers.
  double value() const { return lower_.empty() ? 0 : lower_.top(); }

 private:
  std::priority_queue<double> lower_;  // as many as in upper_, or one more
  std::priority_queue<double, std::vector<double>, std::greater<>> upper_;
};

/// Where a drive looks the same for much longer than usual: in a tunnel places cannot be told
/// apart. A drive falls into stretches: the next place belongs to the stretch while it looks like
/// the first of it (Comparison::same_place), else it begins another one. How far a stretch goes is
/// counted from there to the next one: in changes of the view, and in metres where there are poses;
/// it is long when both are. So a halt is short, and neither speed nor the density of places
/// matter.
class Stretches {
 public:
  explicit Stretches(double same_place) : same_place_(same_place) {}

  /// Takes in the places from the first on that it lacks. Those of a drive are to come in the order
  /// of their frames, also where several processes added them.
  void add(std::span<const StoredPlace> places, const PlaceIndex& index);
  /// Whether the place's stretch goes more than kLong times as far as half of them.
  bool is_long(int64_t place) const;
  /// The places of its stretch, ascending; none for a place that was not taken in yet.
  std::span<const int64_t> around(int64_t place) const;
  /// The same with the stretches of its drive before and behind it.
  std::vector<int64_t> near(int64_t place) const;
  int64_t count() const { return std::ssize(stretches_); }

 private:
  static constexpr double kLong = 5;
  /// The view has changed where places are less similar. Scans of a halt are more so, by far.
  static constexpr double kSameView = 0.95;
  struct Stretch {
    int64_t first, view;  // places: the first one, and the last one that changed the view
    bool has_poses = true;
    double metres = 0;
    double views = 0;
    std::vector<int64_t> places;
    std::optional<int64_t> before, behind;  // stretches of the drive
  };
  const Stretch& stretch_of(int64_t place) const {
    return stretches_[static_cast<size_t>(of_place_[static_cast<size_t>(place)])];
  }
  void add(int64_t place, std::span<const StoredPlace> places, const PlaceIndex& index);

  double same_place_;
  std::vector<Stretch> stretches_;
  std::vector<int64_t> of_place_;           // the stretch of each place
  std::map<std::string, int64_t> current_;  // the last stretch of each drive
  RunningMedian metres_, views_;            // of all but the last of each drive
};

}  // namespace revisit::pipeline
