#include "eval/driving_order.h"

#include <algorithm>
#include <limits>

#include "cli/terminal.h"
#include "eval/eval_options.h"
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
  switch (truth) {
    case PairLabel::kCorrect:
      ++loops.correct;
      break;
    case PairLabel::kIncorrect:
      ++loops.incorrect;
      break;
    case PairLabel::kIgnored:
      ++loops.ignored;
      break;
  }
}

AlignmentRecord record_of(bool described) {
  constexpr float kUnknown = std::numeric_limits<float>::quiet_NaN();
  return {kUnknown, kUnknown, kUnknown, 0, kUnknown, described ? 1.0F : 0.0F};
}

class DrivingOrder {
 public:
  DrivingOrder(const std::vector<ScanRef>& scans, const Trajectory& trajectory,
               const RecognizerSource& source, const DrivingOrderOptions& options)
      : scans_(scans),
        trajectory_(trajectory),
        source_(source),
        options_(options),
        recognizer_(source.extractor, source.options, nullptr, warn),
        detector_(recognizer_, options.detector) {
    Task& task = task_result_.task;
    task.name = kDrivingOrder;
    task.definition =
        "each scan against the places stored before it, beyond the exclusion, as in revisit loops";
    task.population = "each scan against the places stored before it";
    task.exclusion = options.detector.exclusion;
    task.rule = trajectory.listed ? MatchRule{Distance::kPairs, 0} : options.rule;
    need_distances(trajectory, task.rule.distance, "task " + task.name);
    loops_.threshold = detector_.threshold().value_or(0);
  }

  EvaluationResult run() {
    const revisit::Progress progress = options_.observer.stage("recognizing", "scans");
    recognize(stream_of(scans_), detector_, true, options_.observer.stop, [&](const Visit& visit) {
      progress(++row_ + 1, std::ssize(scans_));
      take(visit);
    });
    check_result();
    task_result_.score = detector_.score();
    task_result_.query_case = name_of(source_.options.align);
    task_result_.pca_fit = source_.extractor.fit_projection
                               ? str("the first ", source_.options.warmup, " distinct places")
                               : "none";
    if (!source_.extractor.fit_projection) task_result_.descriptor_dim = source_.extractor.dim;
    task_result_.n_skipped = std::ssize(result_.skipped);
    if (detector_.threshold()) task_result_.loops = loops_;
    measure(task_result_, trajectory_, options_.evaluation, options_.observer.stop);
    if (trajectory_.listed && task_result_.summary.n_positives == 0)
      throw UsageError("task ", kDrivingOrder, ": none of ", task_result_.task.queries.size(),
                       " listed queries can find its place");
    result_.tasks.push_back(std::move(task_result_));
    return std::move(result_);
  }

 private:
  void take(const Visit& visit) {
    const Detection& found = visit.found;
    result_.alignments.push_back(record_of(found.error.empty()));
    if (!found.error.empty()) {
      options_.observer.warn(found.error + "; the scan is skipped");
      result_.skipped.push_back(row_);
      return;
    }
    result_.recognize_ms.push_back(visit.milliseconds);
    Task& task = task_result_.task;
    const auto places = std::ssize(task.stored);
    if (found.index) task.stored.push_back(row_);
    if (!found.loop) return;
    const int64_t match = task.stored.at(static_cast<size_t>(found.loop->index));
    const bool known = !trajectory_.listed || trajectory_.listed->knows(visit.scan.frame);
    if (found.loop->accepted && !known) ++loops_.unlabeled;
    if (!known) return;
    if (found.loop->accepted) count(pair_label(trajectory_, task.rule, row_, match), loops_);
    task.queries.push_back(query_of(row_, found, places));
    task_result_.matches.push_back({.query = row_,
                                    .ranks = {match},
                                    .similarities = {found.loop->similarity},
                                    .score = found.loop->score,
                                    .relative_yaw = found.loop->relative_yaw});
  }

  void check_result() const {
    if (source_.components >= 0 && !recognizer_.is_warmed_up())
      throw UsageError("the PCA cannot be estimated (expected ", source_.options.warmup,
                       " distinct map entries, found fewer in ", recognizer_.size(),
                       " scans); use a smaller --warmup or more scans");
    if (task_result_.task.queries.empty())
      throw UsageError("task ", kDrivingOrder, ": none of ", scans_.size(),
                       " scans has ground truth and a candidate before it; use a smaller exclusion "
                       "or more scans");
  }

  const std::vector<ScanRef>& scans_;
  const Trajectory& trajectory_;
  const RecognizerSource& source_;
  const DrivingOrderOptions& options_;
  PlaceRecognizer recognizer_;
  LoopDetector detector_;
  int64_t row_ = -1;
  AcceptedLoops loops_;
  TaskResult task_result_;
  EvaluationResult result_;
};

}  // namespace

EvaluationResult evaluate_in_driving_order(const std::vector<ScanRef>& scans,
                                           const Trajectory& trajectory,
                                           const RecognizerSource& source,
                                           const DrivingOrderOptions& options) {
  return DrivingOrder(scans, trajectory, source, options).run();
}

}  // namespace revisit::cli
