#include "revisit/evaluation/protocols.h"

#include <set>

#include "protocol_tasks.h"
#include "revisit/base/error.h"
#include "revisit/base/text.h"

namespace revisit {
namespace {

constexpr const char* kPaper =
    "Sun, Liu, Ye, Yeung: Point-cloud-based place recognition using CNN feature extraction";
constexpr Exclusion k50Frames{Exclusion::Kind::kFrames, 50};
constexpr Exclusion k30Seconds{Exclusion::Kind::kSeconds, 30};

struct Entry {
  Protocol protocol;
  Task (*make)(const std::string& sequence, const Trajectory& trajectory,
               const Exclusion& exclusion);
  Exclusion exclusion;
};

/// All protocols except `paper`, which combines up to three of them.
const std::vector<Entry>& table() {
  using S = const std::string&;
  using T = const Trajectory&;
  using E = const Exclusion&;
  static const std::vector<Entry> entries = {
      {{"paper-easy",
        "every 3rd scan is stored, the others are queries; the best match is correct when all "
        "three "
        "coordinate differences are below 3 m",
        kPaper},
       [](S, T t, E) { return paper_easy_task(t); },
       {}},
      {{"paper-median",
        "the scans of the paper's table 1 are stored, all others are queries in alignment case 1; "
        "truth as in paper-easy; KITTI's 00, 05, 06, 08",
        kPaper},
       [](S s, T t, E) { return paper_median_task(s, t); },
       {}},
      {{"paper-difficult",
        "paper-median with the queries in both alignment cases, the higher score counts; KITTI's "
        "08",
        kPaper},
       [](S s, T t, E) { return paper_difficult_task(s, t); },
       {}},
      {{"places-3",
        "every 3rd scan is stored, the others are queries; the best match is correct when it is of "
        "the same named place (the HKUST sets)",
        kPaper},
       [](S, T t, E) { return places_task(3, t); },
       {}},
      {{"places-6", "as places-3 with every 6th scan", kPaper},
       [](S, T t, E) { return places_task(6, t); },
       {}},
      {{"places-10", "as places-3 with every 10th scan", kPaper},
       [](S, T t, E) { return places_task(10, t); },
       {}},
      {{"online",
        "each scan against all scans more than 50 frames before it; the best match is correct when "
        "nearer than 5 m, horizontally",
        "the usual setting of loop detection"},
       [](S, T t, E e) { return online_task(t, e); },
       k50Frames},
      {{"leave-one-out",
        "each scan against all scans more than 50 frames before or after it; truth as in online",
        "for sets without an order of time"},
       [](S, T t, E e) { return leave_one_out_task(t, e); },
       k50Frames},
      {{"lcdnet1",
        "each scan from frame 100 on against all scans more than 50 frames before it; the best "
        "match is correct when nearer than 4 m; an incorrect match is a false positive and not "
        "also a false negative",
        "Cattaneo, Vaghi, Valada: LCDNet, T-RO 2022, protocol 1"},
       [](S, T t, E e) { return lcdnet1_task(t, e); },
       k50Frames},
      {{"lcdnet2",
        "every pair of a scan from frame 100 on with a scan more than 50 frames before it; correct "
        "when nearer than 4 m",
        "Cattaneo, Vaghi, Valada: LCDNet, T-RO 2022, protocol 2"},
       [](S, T t, E e) { return lcdnet2_task(t, e); },
       k50Frames},
      {{"ssc",
        "pairs nearer than 3 m and more than 50 frames apart are correct; 100 times as many pairs, "
        "drawn among those farther apart than 20 m, are incorrect",
        "Li et al.: SSC, Semantic Scan Context, IROS 2021"},
       [](S, T t, E e) { return ssc_task(t, e); },
       k50Frames},
      {{"logg3d",
        "each scan against all scans more than 30 s before it; the best match is correct when "
        "nearer than 3 m, incorrect when farther than 20 m, not counted between; an incorrect "
        "match is not also a false negative",
        "Vidanapathirana et al.: LoGG3D-Net, ICRA 2022"},
       [](S, T t, E e) { return logg3d_task(t, e); },
       k30Seconds},
      {{"bevplace",
        "frames of fixed ranges are stored and queried (00: 0-2999, 3200-4540; 02: 0-3399, "
        "3600-4660; 05: 0-999, 1200-2750; 06: 0-599, 800-1100; 08: 0-999, 1200-4070); the best "
        "match is correct when nearer than 5 m",
        "Luo et al.: BEVPlace, ICCV 2023, and BEVPlace++, T-RO 2025"},
       [](S s, T t, E) { return bevplace_task(s, t); },
       {}},
  };
  return entries;
}

std::string words_for(const Exclusion& exclusion) {
  const char* const units[] = {"", " frames", " s", " m of the way"};
  if (exclusion.kind == Exclusion::Kind::kNone) return "any time";
  return str("more than ", exclusion.amount, units[static_cast<size_t>(exclusion.kind)]);
}

const Entry* find_entry(const std::string& name) {
  for (const Entry& entry : table())
    if (entry.protocol.name == name) return &entry;
  return nullptr;
}

std::vector<std::string> task_names(const std::string& protocol, const std::string& sequence) {
  if (protocol != "paper") return {protocol};
  std::vector<std::string> names{"paper-easy"};
  if (has_median_task(sequence)) names.emplace_back("paper-median");
  if (has_difficult_task(sequence)) names.emplace_back("paper-difficult");
  return names;
}

void need_scans(const Task& task, int64_t n_scans) {
  if (!task.stored.empty() && !task.queries.empty()) return;
  throw UsageError("task ", task.name, " (", task.population, "): of the ", n_scans,
                   " scans of this data set ", task.stored.size(), " are stored and ",
                   task.queries.size(),
                   " can be queried; use another protocol, a smaller exclusion or more scans");
}

void need_exclusion(const Task& task, const std::optional<Exclusion>& requested) {
  const bool excludes =
      task.exclusion.kind != Exclusion::Kind::kNone && task.negatives_per_positive == 0;
  if (!excludes && !(requested && requested->kind == Exclusion::Kind::kNone))
    throw UsageError(
        "task ", task.name, ": with a list of pairs, temporal neighbors of a query would be ",
        "incorrect matches; use the protocol online or leave-one-out, which exclude them ",
        "(or the exclusion none, if all scans show different places)");
}

/// No metric is defined without positives.
void need_positives(const Task& task, const Trajectory& trajectory) {
  for (const TaskQuery& query : task.queries)
    for (const CandidateRange& range : query.candidates)
      for (int64_t c = range.begin; c < range.end; ++c)
        if (pair_label(trajectory, task.rule, query.scan, task.stored[static_cast<size_t>(c)]) ==
            PairLabel::kCorrect)
          return;
  throw UsageError(
      "task ", task.name, ": none of ", task.queries.size(),
      " listed queries has a listed place among its candidates: the places are not stored, within ",
      "the exclusion, or later");
}

void label_by_list(Task& task, const Trajectory& trajectory) {
  task.rule = {Distance::kPairs, 0};
  task.definition += "; truth by a list of pairs";
  std::erase_if(task.queries, [&](const TaskQuery& query) {
    return !trajectory.listed->knows(trajectory.frames[static_cast<size_t>(query.scan)]);
  });
}

}  // namespace

const std::vector<Protocol>& protocols() {
  static const std::vector<Protocol> all = [] {
    std::vector<Protocol> list{
        {"paper", "those of paper-easy, paper-median and paper-difficult that the sequence has",
         kPaper}};
    for (const Entry& entry : table()) list.push_back(entry.protocol);
    return list;
  }();
  return all;
}

std::vector<std::string> protocol_names() {
  std::vector<std::string> names;
  for (const Protocol& protocol : protocols()) names.push_back(protocol.name);
  return names;
}

void remove_scans(Task& task, const std::vector<int64_t>& rows) {
  const std::set<int64_t> out(rows.begin(), rows.end());
  std::vector<int64_t> kept;
  std::vector<int64_t> new_position = {0};  // new index for each old one, and the end
  for (const int64_t row : task.stored) {
    if (!out.contains(row)) kept.push_back(row);
    new_position.push_back(static_cast<int64_t>(kept.size()));
  }
  std::set<int64_t> all(task.stored.begin(), task.stored.end());
  for (const TaskQuery& query : task.queries) all.insert(query.scan);
  task.stored = std::move(kept);
  for (TaskQuery& query : task.queries)
    for (CandidateRange& range : query.candidates)
      range = {new_position.at(static_cast<size_t>(range.begin)),
               new_position.at(static_cast<size_t>(range.end))};
  std::erase_if(task.queries, [&](const TaskQuery& query) {
    return out.contains(query.scan) || query.n_candidates() == 0;
  });
  need_scans(task, static_cast<int64_t>(all.size()));
}

std::vector<Task> make_tasks(const std::string& protocol, const std::string& sequence,
                             const Trajectory& trajectory,
                             const std::optional<Exclusion>& exclusion) {
  std::vector<Task> tasks;
  for (const std::string& name : task_names(protocol, sequence)) {
    const Entry* entry = find_entry(name);
    if (!entry)
      throw UsageError("unknown protocol '", protocol, "'",
                       nearest_name_hint(protocol, protocol_names()),
                       "; known: ", joined(protocol_names(), ", "));
    Task task = entry->make(sequence, trajectory, exclusion.value_or(entry->exclusion));
    task.name = name;
    task.definition = entry->protocol.definition;
    const std::string own = words_for(entry->exclusion);
    if (const size_t at = task.definition.find(own);
        at != std::string::npos && task.exclusion != entry->exclusion)
      task.definition.replace(at, own.size(), words_for(task.exclusion));
    if (trajectory.listed) {
      need_exclusion(task, exclusion);
      label_by_list(task, trajectory);
    }
    need_scans(task, trajectory.size());
    if (trajectory.listed) need_positives(task, trajectory);
    tasks.push_back(std::move(task));
  }
  return tasks;
}

}  // namespace revisit
