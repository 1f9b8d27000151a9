#include "eval/causal.h"

#include <algorithm>
#include <limits>

#include "cli/messages.h"
#include "loops/recognize.h"
#include "revisit/base/error.h"

namespace revisit::cli {
namespace {

/// `places`: map entries at the time of the query.
TaskQuery query_of(int64_t row, const Detection& found, int64_t places) {
  if (found.excluded.empty()) return {row, {CandidateRange{0, places}, {}}};
  const auto [first, last] = std::ranges::minmax(found.excluded);
  return {row, {CandidateRange{0, first}, CandidateRange{last + 1, places}}};
}

void count(PairLabel truth, AcceptedLoops& loops) {
  ++(truth == PairLabel::kCorrect     ? loops.correct
     : truth == PairLabel::kIncorrect ? loops.incorrect
                                      : loops.ignored);
}

AlignmentRecord record_of(bool described) {
  constexpr float kUnknown = std::numeric_limits<float>::quiet_NaN();
  return {kUnknown, kUnknown, kUnknown, 0, kUnknown, described ? 1.0F : 0.0F};
}

}  // namespace

EvaluationResult evaluate_causally(const std::vector<ScanRef>& scans, const Trajectory& trajectory,
                                   const RecognizerSource& source, const CausalOptions& options) {
  PlaceRecognizer recognizer(source.extractor, source.options, nullptr, warn);
  LoopDetector detector(recognizer, options.detector);
  if (options.evaluation.score && detector.verifies())
    throw UsageError("--score: registered loops have a score of their own; add --no-verify");
  EvaluationResult result;
  TaskResult task_result;
  Task& task = task_result.task;
  task.name = "causal";
  task.definition =
      "each scan against the places stored before it, beyond the exclusion, as in revisit loops";
  task.population = "each scan against the places stored before it";
  task.exclusion = options.detector.exclusion;
  task.rule = trajectory.listed ? TrueMatchRule{Distance::kPairs, 0} : options.rule;
  need_distances(trajectory, task.rule.distance, "task " + task.name);
  AcceptedLoops loops;
  loops.threshold = detector.threshold().value_or(0);
  const revisit::Progress progress = options.observer.stage("recognizing", "scans");
  int64_t row = -1;
  recognize(stream_of(scans), detector, true, options.observer.stop, [&](const Visit& visit) {
    const Detection& found = visit.found;
    progress(++row + 1, std::ssize(scans));
    result.alignments.push_back(record_of(found.error.empty()));
    if (!found.error.empty()) {
      options.observer.warn(found.error + "; the scan is skipped");
      result.skipped.push_back(row);
      return;
    }
    result.times.recognize.push_back(visit.milliseconds);
    const auto places = std::ssize(task.stored);
    if (found.index) task.stored.push_back(row);
    if (!found.loop) return;
    const int64_t match = task.stored.at(static_cast<size_t>(found.loop->index));
    const bool known = !trajectory.listed || trajectory.listed->knows(visit.scan.frame);
    if (found.loop->accepted && !known) ++loops.unlabeled;
    if (!known) return;
    if (found.loop->accepted) count(pair_label(trajectory, task.rule, row, match), loops);
    task.queries.push_back(query_of(row, found, places));
    task_result.matches.push_back({.query = row,
                                   .ranks = {match},
                                   .similarities = {found.loop->similarity},
                                   .score = found.loop->score,
                                   .relative_yaw = found.loop->relative_yaw});
  });
  if (source.components >= 0 && !recognizer.is_warmed_up())
    throw UsageError("the PCA cannot be estimated (expected ", source.options.warmup,
                     " distinct map entries, found fewer in ", recognizer.size(),
                     " scans); use a smaller --warmup or more scans");
  if (task.queries.empty())
    throw UsageError("task ", task.name, ": none of ", scans.size(),
                     " scans has ground truth and a ",
                     "candidate before it; use a smaller exclusion or more scans");
  task_result.score = detector.score();
  task_result.query_case = name_of(source.options.align);
  task_result.pca_fit = source.extractor.fit_projection
                            ? str("the first ", source.options.warmup, " distinct places")
                            : "none";
  if (!source.extractor.fit_projection) task_result.descriptor_dim = source.extractor.dim;
  task_result.n_skipped = std::ssize(result.skipped);
  if (detector.threshold()) task_result.loops = loops;
  measure(task_result, trajectory, options.evaluation, options.observer.stop);
  if (trajectory.listed && task_result.summary.n_positives == 0)
    throw UsageError("task ", task.name, ": none of ", task.queries.size(),
                     " listed queries can find its place");
  result.tasks.push_back(std::move(task_result));
  return result;
}

}  // namespace revisit::cli
