#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <map>

#include "revisit/base/error.h"
#include "revisit/datasets/scan_file.h"

namespace revisit {
namespace {

constexpr double kMinPeriod = 0.02, kMaxPeriod = 1, kUsualPeriod = 0.1;  // of scans [s]
constexpr double kLongestTurn = 0.25;  // [s]; a longer period is the distance of keyframes
constexpr double kMaxOffset = 1;       // of a scan's times from its stamp [s]

struct TimeUnit {
  const char* name = "";
  double seconds = 0;
};
constexpr TimeUnit kScanUnit{"scan", 0};
constexpr std::array<TimeUnit, 4> kTimeUnits = {
    {{"s", 1}, {"ms", 1e-3}, {"us", 1e-6}, {"ns", 1e-9}}};

/// Finite values of a scan in ascending order, without the zeros of lost packets. Large scans are
/// sampled.
struct SortedTimes {
  std::vector<double> values;
  size_t distinct = 0;
  bool zeros_are_lost = false;
  const RecordedTimes* of = nullptr;

  double median() const { return values.empty() ? 0 : values[values.size() / 2]; }
};

size_t distinct_in(std::span<const double> sorted) {
  size_t n = sorted.empty() ? 0 : 1;
  for (size_t i = 1; i < sorted.size(); ++i) n += sorted[i] != sorted[i - 1] ? 1 : 0;
  return n;
}

SortedTimes sorted_times(std::span<const double> values) {
  constexpr size_t kFrequent = 8;  // times as often as another value
  constexpr size_t kPercent = 100, kSamples = 4096;
  SortedTimes sorted;
  for (size_t i = 0; i < values.size(); i += values.size() / kSamples | 1)
    if (std::isfinite(values[i])) sorted.values.push_back(values[i]);
  std::ranges::sort(sorted.values);
  sorted.distinct = distinct_in(sorted.values);
  const auto zeros = std::ranges::equal_range(sorted.values, 0.0);
  const size_t n = sorted.values.size(), of_zero = zeros.size();
  if (of_zero == 0 || sorted.distinct < 2) return sorted;
  sorted.zeros_are_lost =
      of_zero * kPercent > n && of_zero * (sorted.distinct - 1) > kFrequent * (n - of_zero);
  if (sorted.zeros_are_lost) {
    sorted.values.erase(zeros.begin(), zeros.end());
    --sorted.distinct;
  }
  return sorted;
}

/// Values at most `half` from their median. Empty if they are less than 80 % of all.
std::span<const double> around_median(const SortedTimes& sorted, double half) {
  const double median = sorted.median();
  const auto first = std::ranges::lower_bound(sorted.values, median - half);
  const auto last = std::ranges::upper_bound(sorted.values, median + half);
  if (5 * (last - first) < 4 * std::ssize(sorted.values)) return {};
  return {first, last};
}

/// Longest distance of a scan's times from their median [s].
double half_window(double period) {
  return std::min(2 * std::clamp(period, kMinPeriod, kMaxPeriod), kMaxOffset);
}

bool has_resolution(const SortedTimes& sorted) {
  constexpr size_t kManyPoints = 32, kFewValues = 8;
  return sorted.distinct >= (sorted.values.size() < kManyPoints ? 2 : kFewValues);
}

/// Curvature is a time in clouds of LIO, and a shape in others, whose values are skewed to 0.
bool is_time_of_lio(std::span<const double> values, double period) {
  constexpr double kMillisecond = 1e-3;
  const double span = values.back() - values.front();
  const double share = span * kMillisecond / period;
  const double median = (values[values.size() / 2] - values.front()) / span;
  return share > 0.25 && share < 1.5 && median > 0.2 && median < 0.8;
}

/// Whether values are fractions of a scan, though they could be up to a second.
bool are_fractions(const SortedTimes& sorted, std::optional<double> period) {
  constexpr double kMost = 1 + 1e-6, kLeastSpan = 0.6, kWholeScan = 0.9;
  const std::span<const double> values = around_median(sorted, kMost);
  if (values.empty() || values.front() < -kMost || values.back() > kMost) return false;
  return values.back() - values.front() >=
         (period.value_or(0) > kLongestTurn ? kWholeScan : kLeastSpan);
}

/// Unit whose span of a scan is nearest to the period; absent if none is plausible.
std::optional<TimeUnit> unit_of_scan(const SortedTimes& sorted, std::optional<double> period) {
  constexpr double kEpoch = 1e6, kNearClock = 100;  // [s]
  constexpr double kShortest = 0.05;                // fraction of a period
  const double typical =
      period ? std::clamp(*period, kMinPeriod, kMaxPeriod) : std::sqrt(kMinPeriod * kMaxPeriod);
  const double shortest = period ? kShortest * std::min(typical, kLongestTurn) : kMinPeriod / 10;
  const std::optional<double> stamp = sorted.of->stamp;
  std::optional<TimeUnit> best;
  double best_distance = std::numeric_limits<double>::infinity();
  for (const TimeUnit& unit : kTimeUnits) {
    const auto values =
        around_median(sorted, (period ? half_window(*period) : kMaxOffset) / unit.seconds);
    if (values.empty()) continue;
    if (sorted.of->field == "curvature" &&
        (unit.seconds != 1e-3 || !is_time_of_lio(values, period.value_or(kUsualPeriod))))
      continue;
    const double span = (values.back() - values.front()) * unit.seconds;
    if (span < shortest || span > kMaxPeriod + kMinPeriod) continue;
    if (stamp > kEpoch && std::abs(sorted.median() * unit.seconds - *stamp) < kNearClock)
      return unit;
    const double distance = std::abs(std::log(span / typical));
    if (distance < best_distance) best = unit;
    best_distance = std::min(distance, best_distance);
  }
  return best;
}

std::optional<double> period_of(std::span<const RecordedTimes> scans) {
  std::vector<double> steps;
  const RecordedTimes* before = nullptr;
  for (const RecordedTimes& scan : scans) {
    if (!scan.stamp) continue;
    if (before && *scan.stamp > *before->stamp) steps.push_back(*scan.stamp - *before->stamp);
    before = &scan;
  }
  if (steps.empty()) return std::nullopt;
  std::ranges::nth_element(steps, steps.begin() + std::ssize(steps) / 2);
  return steps[steps.size() / 2];
}

/// Whether values of consecutive scans grow like the stamps.
bool grow_with_stamps(const SortedTimes& a, const SortedTimes& b, double unit) {
  constexpr double kTolerance = 0.2;
  if (!a.of->stamp || !b.of->stamp || !(*b.of->stamp > *a.of->stamp)) return false;
  const double growth = (b.median() - a.median()) * unit, step = *b.of->stamp - *a.of->stamp;
  return std::abs(growth - step) < kTolerance * step;
}

/// Offset of a clock from that of the stamps [s], NaN unless they are related.
double known_offset(double difference) {
  constexpr double kTai = 37, kGps = 18;  // ahead of UTC since 2017
  for (const double known : {0.0, kTai, -kTai, kGps, -kGps})
    if (std::abs(difference - known) <= kMaxOffset) return known;
  return std::numeric_limits<double>::quiet_NaN();
}

void find_clock(std::span<const SortedTimes> scans, PointTimes& found) {
  std::vector<double> differences;
  size_t of_clock = 0;
  for (const SortedTimes& scan : scans) {
    const double here = scan.median() * found.unit;
    const bool grows = &scan != scans.data() && grow_with_stamps(*(&scan - 1), scan, found.unit);
    of_clock += grows || std::abs(here) > kMaxOffset ? 1 : 0;
    if (scan.of->stamp) differences.push_back(here - *scan.of->stamp);
  }
  found.of_clock = 2 * of_clock >= scans.size();
  if (!found.of_clock) return;
  found.ahead = std::numeric_limits<double>::quiet_NaN();
  if (differences.empty()) return;
  const auto middle = differences.begin() + std::ssize(differences) / 2;
  std::ranges::nth_element(differences, middle);
  found.ahead = known_offset(*middle);
}

std::string text_of_clock(const PointTimes& found) {
  if (!found.of_clock) return "";
  if (found.ahead == 0) return " of the clock of the stamps";
  if (std::isnan(found.ahead)) return " of another clock, from the earliest point";
  return str(" of a clock ", std::abs(found.ahead), " s ", found.ahead > 0 ? "ahead" : "behind",
             " (TAI or GPS)");
}

std::string in_milliseconds(double seconds) {
  constexpr double kMillisecond = 1e-3;
  return str(std::lround(seconds / kMillisecond), " ms");
}

std::string text_of_failure(const SortedTimes& scan, std::optional<double> period) {
  const std::string field = str("none, because field ", scan.of->field);
  if (!has_resolution(scan))
    return str(field, " has no resolution: ", scan.distinct,
               scan.distinct == 1 ? " value" : " values", " in a scan");
  return str(field, " spans ", scan.values.back() - scan.values.front(), " in a scan",
             period ? str(" and scans are ", in_milliseconds(*period), " apart") : "",
             ", which fits no unit; give --point-times");
}

/// The unit of most scans; absent if no scan has one. "scan" has no seconds yet.
std::optional<TimeUnit> voted_unit(std::span<const SortedTimes> scans,
                                   std::optional<double> period) {
  std::map<double, std::pair<int, TimeUnit>> votes;
  for (const SortedTimes& scan : scans) {
    if (!has_resolution(scan)) continue;
    const bool fractions = scan.of->field != "curvature" && are_fractions(scan, period);
    const auto unit = fractions ? std::optional(kScanUnit) : unit_of_scan(scan, period);
    if (!unit) continue;
    auto& [count, voted] = votes[unit->seconds];
    ++count;
    voted = *unit;
  }
  const auto most =
      std::ranges::max_element(votes, {}, [](const auto& vote) { return vote.second.first; });
  return most == votes.end() ? std::nullopt : std::optional(most->second.second);
}

std::optional<TimeUnit> given_unit(const std::string& unit) {
  if (unit == kScanUnit.name) return kScanUnit;
  for (const TimeUnit& known : kTimeUnits)
    if (unit == known.name) return known;
  if (unit == "auto") return std::nullopt;
  throw UsageError("--point-times: expected auto, s, ms, us, ns, scan or none, found '", unit, "'");
}

}  // namespace

PointTimes point_times_of(std::span<const RecordedTimes> scans, const std::string& unit,
                          std::optional<double> period) {
  if (unit == "none") return {.text = "none, as given"};
  std::optional<TimeUnit> found = given_unit(unit);
  const bool given = found.has_value();
  if (!period) period = period_of(scans);
  std::vector<SortedTimes> sorted;
  for (const RecordedTimes& scan : scans) {
    SortedTimes times = sorted_times(scan.values);
    times.of = &scan;
    if (!times.values.empty()) sorted.push_back(std::move(times));
  }
  if (sorted.empty()) return {.text = "none"};
  if (!found) found = voted_unit(sorted, period);
  if (!found) return {.text = text_of_failure(sorted.front(), period)};
  PointTimes times{.unit = found->seconds,
                   .period = given ? kMaxPeriod : period.value_or(kMaxPeriod)};
  const std::string field = str("field ", sorted.front().of->field, ", ");
  if (found->seconds == 0) {
    times.unit = period && *period <= kLongestTurn ? *period : kUsualPeriod;
    times.period = times.unit;
    times.text = str(field, "0 to 1 of a scan of ", in_milliseconds(times.unit));
    return times;
  }
  find_clock(sorted, times);
  if (std::ranges::all_of(sorted, [&](const SortedTimes& scan) {
        return times.of(scan.values, scan.of->stamp).empty();
      }))
    return {.text = text_of_failure(sorted.front(), period)};
  times.text = str(field, found->name, text_of_clock(times));
  return times;
}

std::vector<float> PointTimes::of(std::span<const double> values,
                                  std::optional<double> stamp) const {
  if (unit == 0) return {};
  const SortedTimes sorted = sorted_times(values);
  if (!has_resolution(sorted)) return {};
  const double median = sorted.median(), half = half_window(period) / unit;
  const std::span<const double> valid = around_median(sorted, half);
  if (valid.empty()) return {};
  double zero = 0;  // of the times
  if (of_clock) {
    const bool same_clock = stamp && std::abs(median * unit - *stamp - ahead) <= kMaxOffset;
    zero = same_clock ? (*stamp + ahead) / unit : valid.front();
  }
  std::vector<float> times;
  times.reserve(values.size());
  for (const double value : values) {
    const bool is_valid =
        std::abs(value - median) <= half && !(value == 0 && sorted.zeros_are_lost);
    times.push_back(is_valid ? static_cast<float>((value - zero) * unit)
                             : std::numeric_limits<float>::quiet_NaN());
  }
  return times;
}

void set_times(const RecordedTimes& times, const PointTimes& convention, PointCloud& cloud) {
  cloud.times = convention.of(times.values, times.stamp);
  size_t kept = 0;
  for (size_t i = 0; i < cloud.times.size(); ++i) {
    if (std::isnan(cloud.times[i])) continue;
    cloud.points[kept] = cloud.points[i];
    cloud.times[kept++] = cloud.times[i];
  }
  if (cloud.times.empty()) return;
  cloud.points.resize(kept);
  cloud.times.resize(kept);
}

}  // namespace revisit
