#include <algorithm>
#include <functional>
#include <iterator>
#include <numeric>

#include "protocol_tasks.h"
#include "revisit/base/error.h"

namespace revisit {
namespace {

constexpr int kLcdnetFirstFrame = 100;
constexpr int kSscNegativesPerPositive = 100;

Task against_earlier(const Trajectory& trajectory, const Exclusion& exclusion,
                     int first_frame = 0) {
  Task task;
  task.population = "each scan against all earlier ones beyond the exclusion";
  task.exclusion = exclusion;
  task.stored.resize(trajectory.frames.size());
  std::iota(task.stored.begin(), task.stored.end(), int64_t{0});
  const std::vector<int64_t> ends = earlier_candidates(trajectory, exclusion);
  for (int64_t i = 0; i < trajectory.size(); ++i)
    if (ends[i] > 0 && trajectory.frames[i] >= first_frame)
      task.queries.push_back({i, {CandidateRange{0, ends[i]}, {}}});
  return task;
}

}  // namespace

Task online_task(const Trajectory& trajectory, const Exclusion& exclusion) {
  return against_earlier(trajectory, exclusion);
}

Task leave_one_out_task(const Trajectory& trajectory, const Exclusion& exclusion) {
  Task task = against_earlier(trajectory, exclusion);
  task.population = "each scan against all others, earlier and later, beyond the exclusion";
  task.queries.clear();
  const std::vector<int64_t> ends = earlier_candidates(trajectory, exclusion);
  const std::vector<int64_t> begins = later_candidates(trajectory, exclusion);
  for (int64_t i = 0; i < trajectory.size(); ++i) {
    const TaskQuery query{
        i, {CandidateRange{0, ends[i]}, CandidateRange{begins[i], trajectory.size()}}};
    if (query.n_candidates() > 0) task.queries.push_back(query);
  }
  return task;
}

Task lcdnet1_task(const Trajectory& trajectory, const Exclusion& exclusion) {
  Task task = against_earlier(trajectory, exclusion, kLcdnetFirstFrame);
  task.rule = {Distance::kXz, 4};
  task.rejected_only = true;
  task.margin_score = false;
  return task;
}

Task lcdnet2_task(const Trajectory& trajectory, const Exclusion& exclusion) {
  Task task = against_earlier(trajectory, exclusion, kLcdnetFirstFrame);
  task.population = "pairs of each scan with all earlier ones beyond the exclusion";
  task.rule = {Distance::kXz, 4};
  task.decides_on_pairs = true;
  task.margin_score = false;
  return task;
}

Task ssc_task(const Trajectory& trajectory, const Exclusion& exclusion) {
  // Negative pairs may lie within the exclusion, so all earlier scans are candidates.
  Task task = against_earlier(trajectory, {Exclusion::Kind::kNone, 0});
  task.exclusion = exclusion;
  task.population = "all near pairs beyond the exclusion, and far ones drawn at random";
  task.rule = {Distance::kXz, 3, 20};
  task.decides_on_pairs = true;
  task.margin_score = false;
  task.negatives_per_positive = kSscNegativesPerPositive;
  return task;
}

Task logg3d_task(const Trajectory& trajectory, const Exclusion& exclusion) {
  Task task = against_earlier(trajectory, exclusion);
  task.rule = {Distance::kXz, 3, 20};
  task.rejected_only = true;
  task.margin_score = false;
  return task;
}

namespace {

struct Drive {
  const char* sequence;
  int64_t poses;
};
constexpr Drive kDrives[] = {{"00", 4541}, {"01", 1101}, {"02", 4661}, {"03", 801},
                             {"04", 271},  {"05", 2761}, {"06", 1101}, {"07", 1101},
                             {"08", 4071}, {"09", 1591}, {"10", 1201}};

void need_official_drive(const std::string& protocol, const std::string& sequence,
                         const Trajectory& trajectory) {
  const auto* const drive = std::find_if(std::begin(kDrives), std::end(kDrives),
                                         [&](const Drive& d) { return sequence == d.sequence; });
  const int64_t expected = drive == std::end(kDrives) ? 0 : drive->poses;
  if (trajectory.n_poses == expected) return;
  throw UsageError("protocol ", protocol, ": its frames are those of KITTI's drive ", sequence,
                   ", which has ", expected, " poses; this drive ", sequence, " has ",
                   trajectory.n_poses,
                   ", so it is another; paper-easy, online and leave-one-out work for any");
}

using Chosen = std::function<bool(int64_t row)>;

Task map_task(const Trajectory& trajectory, const Chosen& is_stored, const Chosen& is_query) {
  Task task;
  for (int64_t row = 0; row < trajectory.size(); ++row)
    if (is_stored(row)) task.stored.push_back(row);
  const CandidateRange all{0, static_cast<int64_t>(task.stored.size())};
  for (int64_t row = 0; row < trajectory.size(); ++row)
    if (all.size() > 0 && is_query(row)) task.queries.push_back({row, {all, {}}});
  return task;
}

/// Table 1 of the paper: stored scans, 1-based and inclusive as printed there.
struct StoredScans {
  const char* sequence;
  std::array<std::array<int, 2>, 2> ranges;  // {0, 0}: none
  bool bidirectional;
};
constexpr StoredScans kTable1[] = {
    {"00", {{{1, 200}, {3280, 3840}}}, false},
    {"05", {{{13, 150}, {530, 885}}}, false},
    {"06", {{{1, 276}, {0, 0}}}, false},
    {"08", {{{1420, 1503}, {1620, 1840}}}, true},
};

const StoredScans* table_entry(const std::string& sequence) {
  for (const StoredScans& entry : kTable1)
    if (sequence == entry.sequence) return &entry;
  return nullptr;
}

Task split(const Trajectory& trajectory, const Chosen& is_stored) {
  Task task = map_task(trajectory, is_stored, std::not_fn(is_stored));
  task.rule = {Distance::kBox, 3};
  return task;
}

Task every_nth_stored(int step, const Trajectory& trajectory) {
  Task task = split(trajectory, [step](int64_t row) { return row % step == 0; });
  task.population = str("every ", step, step == 3 ? "rd" : "th",
                        " scan of those there are is stored, all others are queries");
  return task;
}

Task table_task(const StoredScans& entry, const Trajectory& trajectory) {
  Task task = split(trajectory, [&](int64_t row) {
    const int frame = trajectory.frames[static_cast<size_t>(row)];
    return std::any_of(entry.ranges.begin(), entry.ranges.end(), [&](const auto& range) {
      return range[1] && frame + 1 >= range[0] && frame + 1 <= range[1];
    });
  });
  task.population = "stored: scans ";
  for (size_t i = 0; i < entry.ranges.size(); ++i)
    if (entry.ranges[i][1])
      task.population += str(i ? ", " : "", entry.ranges[i][0], "-", entry.ranges[i][1]);
  task.population += " (1-based); all others are queries";
  return task;
}

const StoredScans& need_entry(const std::string& protocol, const std::string& sequence,
                              const Trajectory& trajectory, bool bidirectional) {
  const StoredScans* entry = table_entry(sequence);
  if (entry && (!bidirectional || entry->bidirectional)) {
    need_official_drive(protocol, sequence, trajectory);
    return *entry;
  }
  throw UsageError("protocol ", protocol, ": the paper has no such task for sequence '", sequence,
                   "', only for ", bidirectional ? "08" : "00, 05, 06 and 08",
                   "; paper-easy, online and leave-one-out work for any");
}

/// Half-open frame ranges of BEVPlace (00, 02, 05, 06) and BEVPlace++ (08), with a gap between.
struct Ranges {
  const char* sequence;
  int database_end, query_begin, query_end;
};
constexpr Ranges kRanges[] = {{"00", 3000, 3200, 4541},
                              {"02", 3400, 3600, 4661},
                              {"05", 1000, 1200, 2751},
                              {"06", 600, 800, 1101},
                              {"08", 1000, 1200, 4071}};

const Ranges& ranges_of(const std::string& sequence) {
  for (const Ranges& ranges : kRanges)
    if (sequence == ranges.sequence) return ranges;
  throw UsageError(
      "protocol bevplace: its ranges are published for 00, 02, 05, 06 and 08, not "
      "for sequence '",
      sequence, "'; online and leave-one-out work for any");
}

}  // namespace

bool has_median_task(const std::string& sequence) {
  return table_entry(sequence) != nullptr;
}

bool has_difficult_task(const std::string& sequence) {
  const StoredScans* entry = table_entry(sequence);
  return entry && entry->bidirectional;
}

Task paper_easy_task(const Trajectory& trajectory) {
  return every_nth_stored(3, trajectory);
}

Task paper_median_task(const std::string& sequence, const Trajectory& trajectory) {
  return table_task(need_entry("paper-median", sequence, trajectory, false), trajectory);
}

Task paper_difficult_task(const std::string& sequence, const Trajectory& trajectory) {
  Task task = table_task(need_entry("paper-difficult", sequence, trajectory, true), trajectory);
  task.both_cases = true;
  return task;
}

Task places_task(int step, const Trajectory& trajectory) {
  Task task = every_nth_stored(step, trajectory);
  task.rule = {Distance::kPlace, 1};  // any radius: the distance is 0 or infinite
  return task;
}

Task bevplace_task(const std::string& sequence, const Trajectory& trajectory) {
  const Ranges& r = ranges_of(sequence);
  need_official_drive("bevplace", sequence, trajectory);
  const auto within = [&](int begin, int end) {
    return [&frames = trajectory.frames, begin, end](int64_t row) {
      const int frame = frames[static_cast<size_t>(row)];
      return frame >= begin && frame < end;
    };
  };
  Task task = map_task(trajectory, within(0, r.database_end), within(r.query_begin, r.query_end));
  task.population = str("stored: frames 0-", r.database_end - 1, "; queries: frames ",
                        r.query_begin, "-", r.query_end - 1);
  task.rule = {Distance::kXz, 5};
  task.margin_score = false;
  return task;
}

}  // namespace revisit
