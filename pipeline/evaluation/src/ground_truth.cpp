#include "revisit/evaluation/ground_truth.h"

#include <algorithm>
#include <array>
#include <charconv>
#include <cmath>
#include <limits>
#include <string_view>

#include "revisit/base/error.h"
#include "revisit/base/files.h"
#include "revisit/base/text.h"

namespace revisit {
namespace {

constexpr const char* kDistances[] = {"xy", "xz", "3d", "box", "place", "pairs"};

}  // namespace

Distance parse_distance(const std::string& text) {
  const auto* const found = std::ranges::find(kDistances, text);
  if (found == std::end(kDistances))
    throw UsageError("distance: expected xy, xz, 3d, box or place, found '", text, "'");
  return static_cast<Distance>(found - kDistances);
}

const char* name_of(Distance distance) {
  return kDistances[static_cast<size_t>(distance)];
}

Distance horizontal_distance(const Dataset& dataset) {
  return dataset.camera_axes ? Distance::kXz : Distance::kXy;
}

Trajectory make_trajectory(const Dataset& dataset) {
  Trajectory trajectory;
  trajectory.horizontal = horizontal_distance(dataset);
  trajectory.n_poses = dataset.n_poses;
  const bool has_poses = dataset.has_poses();
  bool has_times = !dataset.scans.empty();
  for (const ScanRef& scan : dataset.scans) has_times &= scan.time.has_value();
  for (const ScanRef& scan : dataset.scans) {
    if (!trajectory.frames.empty() && scan.frame <= trajectory.frames.back())
      throw InputError(scan.file.string(), ": frame ", scan.frame, " comes after frame ",
                       trajectory.frames.back(), "; frames must increase");
    trajectory.frames.push_back(scan.frame);
    if (has_times) trajectory.times.push_back(*scan.time);
    if (dataset.has_places()) trajectory.places.push_back(scan.place);
    if (!has_poses) continue;
    trajectory.positions.emplace_back(scan.pose->translation());
    if (!trajectory.positions.back().allFinite())
      throw InputError(scan.file.string(), ": the pose of frame ", scan.frame, " is not finite");
  }
  return trajectory;
}

double distance_between(const Eigen::Vector3d& a, const Eigen::Vector3d& b, Distance kind) {
  const Eigen::Vector3d difference = a - b;
  switch (kind) {
    case Distance::kXy:
      return std::sqrt(difference.x() * difference.x() + difference.y() * difference.y());
    case Distance::kXz:
      return std::sqrt(difference.x() * difference.x() + difference.z() * difference.z());
    case Distance::k3d:
      return difference.norm();
    case Distance::kBox:
      return difference.cwiseAbs().maxCoeff();
    case Distance::kPlace:
    case Distance::kPairs:
      break;
  }
  throw Error("the distance ", name_of(kind), " is not one of positions");
}

double distance_between(const Trajectory& trajectory, int64_t a, int64_t b, Distance kind) {
  if (kind == Distance::kPlace)
    return trajectory.places.at(a) == trajectory.places.at(b)
               ? 0
               : std::numeric_limits<double>::infinity();
  return distance_between(trajectory.positions.at(a), trajectory.positions.at(b), kind);
}

std::vector<double> distance_along(const Trajectory& trajectory, Exclusion::Kind kind,
                                   const char* what) {
  const bool in_seconds = kind == Exclusion::Kind::kSeconds;
  if (in_seconds && trajectory.times.empty())
    throw UsageError(what,
                     " in seconds: the data set has no time stamps (times.txt); use frames=N");
  if (kind == Exclusion::Kind::kMeters && trajectory.positions.empty())
    throw UsageError(what, " in meters: the data set has no poses; use frames=N");
  std::vector<double> along;
  ExclusionCounter driven({kind, 0});
  for (size_t i = 0; i < trajectory.frames.size(); ++i) {
    std::optional<double> time;
    std::optional<Eigen::Vector3d> position;
    if (!trajectory.times.empty()) time = trajectory.times[i];
    if (!trajectory.positions.empty()) position = trajectory.positions[i];
    along.push_back(driven.at(trajectory.frames[i], time, position));
    if (in_seconds && i > 0 && !(along[i] >= along[i - 1]))
      throw InputError("the time stamps decrease at frame ", trajectory.frames[i], ": ",
                       along[i - 1], " s, then ", along[i], " s");
  }
  return along;
}

PairLabel pair_label(const Trajectory& trajectory, const MatchRule& rule, int64_t query,
                     int64_t match) {
  if (rule.distance == Distance::kPairs) {
    const ListedPairs& listed = trajectory.listed.value();
    const int queried = trajectory.frames.at(query), found = trajectory.frames.at(match);
    const auto has = [](const ListedPairs::Places& places, int from, int to) {
      const auto of_query = places.find(from);
      return of_query != places.end() && of_query->second.contains(to);
    };
    const auto holds = [&](const ListedPairs::Places& places) {
      return has(places, queried, found) || has(places, found, queried);
    };
    if (holds(listed.correct)) return PairLabel::kCorrect;
    return holds(listed.ignored) || !listed.knows(queried) ? PairLabel::kIgnored
                                                           : PairLabel::kIncorrect;
  }
  const double meters = distance_between(trajectory, query, match, rule.distance);
  if (rule.is_correct(meters)) return PairLabel::kCorrect;
  return rule.is_incorrect(meters) ? PairLabel::kIncorrect : PairLabel::kIgnored;
}

void need_distances(const Trajectory& trajectory, Distance kind, const std::string& what) {
  if (kind == Distance::kPlace && trajectory.places.empty())
    throw UsageError(what, " needs named places; this data set has none");
  if (kind == Distance::kPairs) {
    if (!trajectory.listed) throw UsageError(what, " needs a list of pairs");
    return;
  }
  if (kind == Distance::kPlace || !trajectory.positions.empty()) return;
  if (trajectory.places.empty()) throw UsageError(what, " needs poses; this data set has none");
  throw UsageError(what,
                   " needs poses; this data set has none, but places: use the distance place");
}

std::vector<int64_t> earlier_candidates(const Trajectory& trajectory, const Exclusion& exclusion) {
  const std::vector<double> along = distance_along(trajectory, exclusion.kind);
  const bool none = exclusion.kind == Exclusion::Kind::kNone;
  std::vector<int64_t> ends;
  for (auto here = along.begin(); here != along.end(); ++here)
    ends.push_back(std::partition_point(
                       along.begin(), here,
                       [&](double before) { return none || *here - before > exclusion.amount; }) -
                   along.begin());
  return ends;
}

std::vector<int64_t> later_candidates(const Trajectory& trajectory, const Exclusion& exclusion) {
  const std::vector<double> along = distance_along(trajectory, exclusion.kind);
  const bool none = exclusion.kind == Exclusion::Kind::kNone;
  std::vector<int64_t> begins;
  for (auto here = along.begin(); here != along.end(); ++here)
    begins.push_back(std::partition_point(
                         here + 1, along.end(),
                         [&](double after) { return !none && after - *here <= exclusion.amount; }) -
                     along.begin());
  return begins;
}

std::vector<std::pair<int64_t, int64_t>> find_loops(const Trajectory& trajectory,
                                                    const MatchRule& rule,
                                                    const Exclusion& exclusion) {
  need_distances(trajectory, rule.distance, "ground truth");
  if (!(rule.radius > 0) || !std::isfinite(rule.radius))
    throw UsageError("radius: expected a positive number of meters, found ", rule.radius);
  const std::vector<int64_t> ends = earlier_candidates(trajectory, exclusion);
  std::vector<std::pair<int64_t, int64_t>> pairs;
  for (int64_t i = 0; i < trajectory.size(); ++i)
    for (int64_t j = 0; j < ends[i]; ++j)
      if (rule.is_correct(distance_between(trajectory, i, j, rule.distance)))
        pairs.emplace_back(i, j);
  return pairs;
}

namespace {

constexpr std::array<std::string_view, 4> kQueryColumns = {"query", "query_index", "query_frame",
                                                           "frame"};
constexpr std::array<std::string_view, 5> kPlaceColumns = {"place", "match", "match_index",
                                                           "match_frame", "place_frame"};

std::string trimmed(std::string_view text) {
  constexpr std::string_view kBlanks = " \t\r\"";
  const size_t begin = text.find_first_not_of(kBlanks);
  if (begin == std::string_view::npos) return "";
  return std::string(text.substr(begin, text.find_last_not_of(kBlanks) + 1 - begin));
}

/// Cells of a line; blanks are separators only in lines without others.
std::vector<std::string> cells_of(std::string_view line) {
  std::string_view separators = ",;\t";
  const std::string text = trimmed(line);
  if (line.find_first_of(separators) == std::string_view::npos) {
    separators = " ";
    line = text;
  }
  std::vector<std::string> cells;
  while (true) {
    const size_t end = std::min(line.find_first_of(separators), line.size());
    std::string cell = trimmed(line.substr(0, end));
    if (!cell.empty() || separators != " ") cells.push_back(std::move(cell));
    if (end == line.size()) return cells;
    line.remove_prefix(end + 1);
  }
}

template <size_t n>
std::optional<size_t> column_of(const std::vector<std::string>& header,
                                const std::array<std::string_view, n>& names) {
  for (const std::string_view name : names)
    if (const auto at = std::ranges::find(header, name); at != header.end())
      return static_cast<size_t>(at - header.begin());
  return std::nullopt;
}

class ScanNames {
 public:
  explicit ScanNames(const Dataset& dataset) : dataset_(dataset) {
    for (size_t row = 0; row < dataset.scans.size(); ++row) {
      const ScanRef& scan = dataset.scans[row];
      const std::string folder = scan.place.empty() ? "" : scan.place + "/";
      rows_[folder + scan.file.stem().string()].insert(row);
      rows_[folder + scan.file.filename().string()].insert(row);
      of_frames_.emplace(scan.frame, row);
    }
  }

  size_t row_of(const std::string& name, const std::string& where) const {
    std::set<size_t> rows;
    if (const auto named = rows_.find(name); named != rows_.end()) rows = named->second;
    int frame = 0;
    const char* const end = name.data() + name.size();
    const auto [stop, error] = std::from_chars(name.data(), end, frame);
    const auto numbered = of_frames_.find(frame);
    if (error == std::errc() && stop == end && numbered != of_frames_.end())
      rows.insert(numbered->second);
    if (rows.size() == 1) return *rows.begin();
    if (!rows.empty()) {
      const auto file_of = [&](size_t row) { return dataset_.scans[row].file.string(); };
      throw InputError(where, ": '", name.substr(0, 80), "' may be ", file_of(*rows.begin()),
                       " or ", file_of(*rows.rbegin()), ": give the whole name of the file");
    }
    const ScanRef &first = dataset_.scans.front(), &last = dataset_.scans.back();
    const auto name_of = [](const ScanRef& scan) {
      return (scan.place.empty() ? "" : scan.place + "/") + scan.file.stem().string();
    };
    throw InputError(where, ": expected a scan of ", dataset_.name, ", frame ", first.frame, " (",
                     name_of(first), ") to ", last.frame, " (", name_of(last), "), found '",
                     name.substr(0, 80), "'");
  }

 private:
  const Dataset& dataset_;
  std::map<std::string, std::set<size_t>> rows_;
  std::map<int, size_t> of_frames_;
};

void add_near(const Dataset& dataset, size_t row, int near, std::set<int>& frames) {
  const ScanRef& place = dataset.scans[row];
  const auto counts = [&](const ScanRef& scan) {
    return scan.place == place.place && std::abs(scan.frame - place.frame) <= near;
  };
  size_t first = row, end = row + 1;
  while (first > 0 && counts(dataset.scans[first - 1])) --first;
  while (end < dataset.scans.size() && counts(dataset.scans[end])) ++end;
  for (size_t at = first; at < end; ++at) frames.insert(dataset.scans[at].frame);
}

}  // namespace

std::string ListedPairs::text() const {
  std::string text = complete ? "complete" : "";
  for (const auto& [kind, places] :
       {std::pair("correct", &correct), std::pair("ignored", &ignored)}) {
    text += str("\n", kind);
    for (const auto& [query, of_query] : *places)
      text += str(" ", query, ":", joined(of_query, ","));
  }
  return text;
}

ListedPairs::Places read_pairs(const std::filesystem::path& file, const Dataset& dataset,
                               int near) {
  if (near < 0) throw UsageError("pairs: expected at least 0 frames near a place, found ", near);
  if (dataset.scans.empty()) throw UsageError("pairs: the data set has no scans");
  const ScanNames names(dataset);
  const std::string content = read_content(file);
  ListedPairs::Places pairs;
  size_t query = 0, place = 1;
  bool first = true;
  std::string_view rest = content;
  if (rest.starts_with("\xEF\xBB\xBF")) rest.remove_prefix(3);
  for (int64_t number = 1; !rest.empty(); ++number) {
    const size_t end = std::min(rest.find('\n'), rest.size());
    std::string_view line = rest.substr(0, end);
    rest.remove_prefix(std::min(end + 1, rest.size()));
    line = line.substr(0, line.find('#'));
    const std::vector<std::string> cells = cells_of(line);
    if (std::ranges::all_of(cells, &std::string::empty)) continue;
    const std::string where = str(file.string(), ":", number);
    if (std::exchange(first, false))
      if (const auto queries = column_of(cells, kQueryColumns)) {
        const auto places = column_of(cells, kPlaceColumns);
        if (!places) throw InputError(where, ": expected a column 'place' beside the queries");
        query = *queries;
        place = *places;
        continue;
      }
    if (query >= cells.size() || cells[query].empty())
      throw InputError(where, ": expected a query and its place, found '", trimmed(line), "'");
    std::set<int>& frames = pairs[dataset.scans[names.row_of(cells[query], where)].frame];
    if (place < cells.size() && !cells[place].empty())
      add_near(dataset, names.row_of(cells[place], where), near, frames);
  }
  if (pairs.empty()) throw InputError(file.string(), ": lists no pairs");
  return pairs;
}

}  // namespace revisit
