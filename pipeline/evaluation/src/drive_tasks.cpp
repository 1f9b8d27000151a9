#include <numeric>

#include "protocol_tasks.h"

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
  task.missed = Missed::kRejected;
  task.margin_score = false;
  return task;
}

Task lcdnet2_task(const Trajectory& trajectory, const Exclusion& exclusion) {
  Task task = against_earlier(trajectory, exclusion, kLcdnetFirstFrame);
  task.population = "pairs of each scan with all earlier ones beyond the exclusion";
  task.rule = {Distance::kXz, 4};
  task.decision = Decision::kPair;
  task.margin_score = false;
  return task;
}

Task ssc_task(const Trajectory& trajectory, const Exclusion& exclusion) {
  // Negative pairs may lie within the exclusion, so all earlier scans are candidates.
  Task task = against_earlier(trajectory, {Exclusion::Kind::kNone, 0});
  task.exclusion = exclusion;
  task.population = "all near pairs beyond the exclusion, and far ones drawn at random";
  task.rule = {Distance::kXz, 3, 20};
  task.decision = Decision::kPair;
  task.margin_score = false;
  task.negatives_per_positive = kSscNegativesPerPositive;
  return task;
}

Task logg3d_task(const Trajectory& trajectory, const Exclusion& exclusion) {
  Task task = against_earlier(trajectory, exclusion);
  task.rule = {Distance::kXz, 3, 20};
  task.missed = Missed::kRejected;
  task.margin_score = false;
  return task;
}

}  // namespace revisit
