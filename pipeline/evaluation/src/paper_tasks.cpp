#include <algorithm>

#include "kitti_drives.h"
#include "protocol_tasks.h"
#include "revisit/base/error.h"

namespace revisit::pipeline {
namespace {

/// Table 1 of the paper: the stored scans, 1-based and inclusive as printed there.
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

/// Stores the scans whose row `is_stored` accepts; asks all others against all of them.
Task split(const Trajectory& trajectory, const std::function<bool(int64_t row)>& is_stored) {
  std::vector<int64_t> stored, asked;
  for (int64_t row = 0; row < trajectory.size(); ++row)
    (is_stored(row) ? stored : asked).push_back(row);
  Task task = map_task(std::move(stored), asked);
  task.rule = {Distance::kBox, 3};
  return task;
}

/// Every `step`-th of the scans that are there: of a drive with gaps in its frame numbers, too.
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

/// The table's entry, or a UsageError saying which sequences have one.
const StoredScans& need_entry(const std::string& protocol, const std::string& sequence,
                              const Trajectory& trajectory, bool bidirectional) {
  const StoredScans* entry = table_entry(sequence);
  if (entry && (!bidirectional || entry->bidirectional)) {
    need_official_drive(protocol, sequence, trajectory);
    return *entry;
  }
  throw UsageError(str("protocol ", protocol, ": the paper has no such task for sequence '",
                       sequence, "', only for ", bidirectional ? "08" : "00, 05, 06 and 08",
                       "; paper-easy, online and leave-one-out work for any"));
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

}  // namespace revisit::pipeline
