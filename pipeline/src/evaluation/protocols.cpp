#include "revisit/pipeline/protocols.h"

#include <algorithm>
#include <functional>
#include <numeric>

#include "revisit/proto/error.h"

namespace revisit::pipeline {
namespace {

constexpr TrueMatchRule kPaperRule{Distance::kBox, 3};
constexpr TrueMatchRule kDriveRule{Distance::kXz, 5};

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

/// Stores the scans whose frame `is_stored` accepts; asks all others against all of them.
Task split(std::string name, std::string population, const Trajectory& trajectory,
           const std::function<bool(int frame)>& is_stored) {
  Task task{std::move(name), std::move(population),      {}, {}, false,
            kPaperRule,      {Exclusion::Kind::kNone, 0}};
  for (int64_t i = 0; i < trajectory.size(); ++i)
    if (is_stored(trajectory.frames[i])) task.stored.push_back(i);
  const CandidateRange all{0, static_cast<int64_t>(task.stored.size())};
  for (int64_t i = 0; i < trajectory.size(); ++i)
    if (!is_stored(trajectory.frames[i])) task.queries.push_back({i, {all, {}}});
  return task;
}

Task easy(const Trajectory& trajectory) {
  return split("paper-easy", "every 3rd scan stored (frame % 3 == 0), all others are queries",
               trajectory, [](int frame) { return frame % 3 == 0; });
}

Task table_task(const StoredScans& entry, bool difficult, const Trajectory& trajectory) {
  std::string population = "stored: scans ";
  for (size_t i = 0; i < entry.ranges.size(); ++i)
    if (entry.ranges[i][1])
      population += str(i ? ", " : "", entry.ranges[i][0], "-", entry.ranges[i][1]);
  population += " (1-based); all others are queries, in alignment case 1";
  if (difficult) population += " and case 2";
  Task task =
      split(difficult ? "paper-difficult" : "paper-median", population, trajectory, [&](int frame) {
        return std::any_of(entry.ranges.begin(), entry.ranges.end(), [&](const auto& range) {
          return range[1] && frame + 1 >= range[0] && frame + 1 <= range[1];
        });
      });
  task.both_cases = difficult;
  return task;
}

Task online(const Trajectory& trajectory, const Exclusion& exclusion) {
  Task task{"online", "each scan against all earlier ones beyond the exclusion",
            {},       {},
            false,    kDriveRule,
            exclusion};
  task.stored.resize(trajectory.frames.size());
  std::iota(task.stored.begin(), task.stored.end(), 0);
  const std::vector<int64_t> ends = earlier_candidates(trajectory, exclusion);
  for (int64_t i = 0; i < trajectory.size(); ++i)
    if (ends[i] > 0) task.queries.push_back({i, {CandidateRange{0, ends[i]}, {}}});
  return task;
}

Task leave_one_out(const Trajectory& trajectory, const Exclusion& exclusion) {
  Task task = online(trajectory, exclusion);
  task.name = "leave-one-out";
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

/// The table's tasks of one sequence, or a UsageError saying which sequences have them.
const StoredScans& need_table_entry(const std::string& protocol, const std::string& sequence) {
  const StoredScans* entry = table_entry(sequence);
  const bool difficult = protocol == "paper-difficult";
  if (entry && (!difficult || entry->bidirectional)) return *entry;
  throw UsageError(str("protocol ", protocol, ": the paper has no such task for sequence '",
                       sequence, "', only for ", difficult ? "08" : "00, 05, 06 and 08",
                       "; paper-easy, online and leave-one-out work for any"));
}

}  // namespace

std::vector<std::string> protocol_names() {
  return {"paper", "paper-easy", "paper-median", "paper-difficult", "online", "leave-one-out"};
}

std::vector<Task> make_tasks(const std::string& protocol, const std::string& sequence,
                             const Trajectory& trajectory, const Exclusion& exclusion) {
  std::vector<Task> tasks;
  const StoredScans* entry = table_entry(sequence);
  if (protocol == "paper") {
    tasks.push_back(easy(trajectory));
    if (entry) tasks.push_back(table_task(*entry, false, trajectory));
    if (entry && entry->bidirectional) tasks.push_back(table_task(*entry, true, trajectory));
  } else if (protocol == "paper-easy") {
    tasks.push_back(easy(trajectory));
  } else if (protocol == "paper-median" || protocol == "paper-difficult") {
    const StoredScans& found = need_table_entry(protocol, sequence);
    tasks.push_back(table_task(found, protocol == "paper-difficult", trajectory));
  } else if (protocol == "online") {
    tasks.push_back(online(trajectory, exclusion));
  } else if (protocol == "leave-one-out") {
    tasks.push_back(leave_one_out(trajectory, exclusion));
  } else {
    throw UsageError(
        str("unknown protocol '", protocol, "'", did_you_mean(protocol, protocol_names()),
            "; known: paper, paper-easy, paper-median, paper-difficult, online, leave-one-out"));
  }
  for (const Task& task : tasks)
    if (task.stored.empty() || task.queries.empty() || task.queries[0].n_candidates() == 0)
      throw UsageError(
          str("task ", task.name, " (", task.population, "): of the ", trajectory.size(),
              " scans of this data set ", task.stored.size(), " are stored and ",
              task.stored.empty() ? 0 : task.queries.size(),
              " can be asked; use another protocol, a smaller exclusion or more scans"));
  return tasks;
}

}  // namespace revisit::pipeline
