#include "revisit/evaluation/protocols.h"

#include <algorithm>
#include <functional>
#include <iterator>
#include <numeric>
#include <set>

#include "revisit/base/error.h"
#include "revisit/base/text.h"

namespace revisit {
namespace {

// Functions of the table below add the stored scans and the queries of a task, which has all else.
// They throw UsageError if the sequence has no such task.

void add_earlier(Task& task, const Trajectory& trajectory, const Exclusion& exclusion,
                 int first_frame = 0) {
  task.stored.resize(trajectory.frames.size());
  std::iota(task.stored.begin(), task.stored.end(), int64_t{0});
  const std::vector<int64_t> ends = earlier_candidates(trajectory, exclusion);
  for (int64_t i = 0; i < trajectory.size(); ++i)
    if (ends[i] > 0 && trajectory.frames[i] >= first_frame)
      task.queries.push_back({i, {CandidateRange{0, ends[i]}, {}}});
}

template <int first_frame>
void earlier_scans(Task& task, const std::string&, const Trajectory& trajectory) {
  add_earlier(task, trajectory, task.exclusion, first_frame);
}

/// For negative pairs that may lie within the exclusion.
void all_earlier_scans(Task& task, const std::string&, const Trajectory& trajectory) {
  add_earlier(task, trajectory, {Exclusion::Kind::kNone, 0});
}

void all_other_scans(Task& task, const std::string&, const Trajectory& trajectory) {
  add_earlier(task, trajectory, task.exclusion);
  task.queries.clear();
  const std::vector<int64_t> ends = earlier_candidates(trajectory, task.exclusion);
  const std::vector<int64_t> begins = later_candidates(trajectory, task.exclusion);
  for (int64_t i = 0; i < trajectory.size(); ++i) {
    const TaskQuery query{
        i, {CandidateRange{0, ends[i]}, CandidateRange{begins[i], trajectory.size()}}};
    if (query.n_candidates() > 0) task.queries.push_back(query);
  }
}

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

void add_map(Task& task, const Trajectory& trajectory, const Chosen& is_stored,
             const Chosen& is_query) {
  for (int64_t row = 0; row < trajectory.size(); ++row)
    if (is_stored(row)) task.stored.push_back(row);
  const CandidateRange all{0, static_cast<int64_t>(task.stored.size())};
  for (int64_t row = 0; row < trajectory.size(); ++row)
    if (all.size() > 0 && is_query(row)) task.queries.push_back({row, {all, {}}});
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
    {"08", {{{1420, 1503}, {1620, 1840}}}, true},  // the only one with reverse revisits
};

const StoredScans* table_entry(const std::string& sequence) {
  for (const StoredScans& entry : kTable1)
    if (sequence == entry.sequence) return &entry;
  return nullptr;
}

template <int step>
void every_nth_stored(Task& task, const std::string&, const Trajectory& trajectory) {
  const auto is_stored = [](int64_t row) { return row % step == 0; };
  add_map(task, trajectory, is_stored, std::not_fn(is_stored));
  task.population = str("every ", step, step == 3 ? "rd" : "th",
                        " scan of those there are is stored, all others are queries");
}

const StoredScans& need_entry(const Task& task, const std::string& sequence,
                              const Trajectory& trajectory) {
  const StoredScans* entry = table_entry(sequence);
  if (entry && (!task.both_cases || entry->bidirectional)) {
    need_official_drive(task.name, sequence, trajectory);
    return *entry;
  }
  throw UsageError("protocol ", task.name, ": the paper has no such task for sequence '", sequence,
                   "', only for ", task.both_cases ? "08" : "00, 05, 06 and 08",
                   "; paper-easy, online and leave-one-out work for any");
}

void table_stored(Task& task, const std::string& sequence, const Trajectory& trajectory) {
  const StoredScans& entry = need_entry(task, sequence, trajectory);
  const auto is_stored = [&](int64_t row) {
    const int frame = trajectory.frames[static_cast<size_t>(row)];
    return std::any_of(entry.ranges.begin(), entry.ranges.end(), [&](const auto& range) {
      return range[1] && frame + 1 >= range[0] && frame + 1 <= range[1];
    });
  };
  add_map(task, trajectory, is_stored, std::not_fn(is_stored));
  task.population = "stored: scans ";
  for (size_t i = 0; i < entry.ranges.size(); ++i)
    if (entry.ranges[i][1])
      task.population += str(i ? ", " : "", entry.ranges[i][0], "-", entry.ranges[i][1]);
  task.population += " (1-based); all others are queries";
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
      "protocol bevplace: its ranges are published for 00, 02, 05, 06 and 08, not for sequence '",
      sequence, "'; online and leave-one-out work for any");
}

void bevplace_scans(Task& task, const std::string& sequence, const Trajectory& trajectory) {
  const Ranges& r = ranges_of(sequence);
  need_official_drive("bevplace", sequence, trajectory);
  const auto within = [&](int begin, int end) {
    return [&frames = trajectory.frames, begin, end](int64_t row) {
      const int frame = frames[static_cast<size_t>(row)];
      return frame >= begin && frame < end;
    };
  };
  add_map(task, trajectory, within(0, r.database_end), within(r.query_begin, r.query_end));
  task.population = str("stored: frames 0-", r.database_end - 1, "; queries: frames ",
                        r.query_begin, "-", r.query_end - 1);
}

constexpr const char* kPaper =
    "Sun, Liu, Ye, Yeung: Point-cloud-based place recognition using CNN feature extraction";
constexpr Exclusion k50Frames{Exclusion::Kind::kFrames, 50};

constexpr const char* kEarlier = "each scan against all earlier ones beyond the exclusion";
constexpr MatchRule kBox{Distance::kBox, 3};
constexpr MatchRule kSamePlace{Distance::kPlace, 1};  // any radius: the distance is 0 or infinite

struct Entry {
  Protocol protocol;
  void (*add_scans)(Task& task, const std::string& sequence, const Trajectory& trajectory);
  Task task;  // Distance::kXy stands for the horizontal one of the trajectory
};

/// All protocols except `paper`, which combines up to three of them.
const std::vector<Entry>& table() {
  static const std::vector<Entry> entries = {
      {{"paper-easy",
        "every 3rd scan is stored, the others are queries; the best match is correct when all "
        "three coordinate differences are below 3 m",
        kPaper},
       every_nth_stored<3>,
       {.rule = kBox}},
      {{"paper-median",
        "the scans of the paper's table 1 are stored, all others are queries in alignment case 1; "
        "truth as in paper-easy; KITTI's 00, 05, 06, 08",
        kPaper},
       table_stored,
       {.rule = kBox}},
      {{"paper-difficult",
        "paper-median with the queries in both alignment cases, the higher score counts; KITTI's "
        "08",
        kPaper},
       table_stored,
       {.both_cases = true, .rule = kBox}},
      {{"places-3",
        "every 3rd scan is stored, the others are queries; the best match is correct when it is of "
        "the same named place (the HKUST sets)",
        kPaper},
       every_nth_stored<3>,
       {.rule = kSamePlace}},
      {{"places-6", "as places-3 with every 6th scan", kPaper},
       every_nth_stored<6>,
       {.rule = kSamePlace}},
      {{"places-10", "as places-3 with every 10th scan", kPaper},
       every_nth_stored<10>,
       {.rule = kSamePlace}},
      {{"online",
        "each scan against all scans more than 50 frames before it; the best match is correct when "
        "nearer than 5 m, horizontally",
        "the usual setting of loop detection"},
       earlier_scans<0>,
       {.population = kEarlier, .exclusion = k50Frames}},
      {{"leave-one-out",
        "each scan against all scans more than 50 frames before or after it; truth as in online",
        "for sets without an order of time"},
       all_other_scans,
       {.population = "each scan against all others, earlier and later, beyond the exclusion",
        .exclusion = k50Frames}},
      {{"lcdnet1",
        "each scan from frame 100 on against all scans more than 50 frames before it; the best "
        "match is correct when nearer than 4 m; an incorrect match is a false positive and not "
        "also a false negative",
        "Cattaneo, Vaghi, Valada: LCDNet, T-RO 2022, protocol 1"},
       earlier_scans<100>,
       {.population = kEarlier,
        .rule = {Distance::kXy, 4},
        .exclusion = k50Frames,
        .rejected_only = true,
        .margin_score = false}},
      {{"lcdnet2",
        "every pair of a scan from frame 100 on with a scan more than 50 frames before it; correct "
        "when nearer than 4 m",
        "Cattaneo, Vaghi, Valada: LCDNet, T-RO 2022, protocol 2"},
       earlier_scans<100>,
       {.population = "pairs of each scan with all earlier ones beyond the exclusion",
        .rule = {Distance::kXy, 4},
        .exclusion = k50Frames,
        .decides_on_pairs = true,
        .margin_score = false}},
      {{"ssc",
        "pairs nearer than 3 m and more than 50 frames apart are correct; 100 times as many pairs, "
        "drawn among those farther apart than 20 m, are incorrect",
        "Li et al.: SSC, Semantic Scan Context, IROS 2021"},
       all_earlier_scans,
       {.population = "all near pairs beyond the exclusion, and far ones drawn at random",
        .rule = {Distance::kXy, 3, 20},
        .exclusion = k50Frames,
        .decides_on_pairs = true,
        .margin_score = false,
        .negatives_per_positive = 100}},
      {{"logg3d",
        "each scan against all scans more than 30 s before it; the best match is correct when "
        "nearer than 3 m, incorrect when farther than 20 m, not counted between; an incorrect "
        "match is not also a false negative",
        "Vidanapathirana et al.: LoGG3D-Net, ICRA 2022"},
       earlier_scans<0>,
       {.population = kEarlier,
        .rule = {Distance::kXy, 3, 20},
        .exclusion = {Exclusion::Kind::kSeconds, 30},
        .rejected_only = true,
        .margin_score = false}},
      {{"bevplace",
        "frames of fixed ranges are stored and queried (00: 0-2999, 3200-4540; 02: 0-3399, "
        "3600-4660; 05: 0-999, 1200-2750; 06: 0-599, 800-1100; 08: 0-999, 1200-4070); the best "
        "match is correct when nearer than 5 m",
        "Luo et al.: BEVPlace, ICCV 2023, and BEVPlace++, T-RO 2025"},
       bevplace_scans,
       {.margin_score = false}},
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
  const StoredScans* entry = table_entry(sequence);
  if (entry) names.emplace_back("paper-median");
  if (entry && entry->bidirectional) names.emplace_back("paper-difficult");
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
    Task task = entry->task;
    task.name = name;
    task.definition = entry->protocol.definition;
    if (task.rule.distance == Distance::kXy) task.rule.distance = trajectory.horizontal;
    const bool excludes = task.exclusion.kind != Exclusion::Kind::kNone;
    if (excludes) task.exclusion = exclusion.value_or(task.exclusion);
    entry->add_scans(task, sequence, trajectory);
    const std::string own = words_for(entry->task.exclusion);
    if (const size_t at = task.definition.find(own);
        at != std::string::npos && task.exclusion != entry->task.exclusion)
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
