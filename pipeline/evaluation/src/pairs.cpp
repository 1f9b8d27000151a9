#include <numeric>
#include <random>
#include <tuple>

#include "ballots.h"
#include "revisit/engine/parallel_for.h"
#include "revisit/evaluation/evaluate.h"
#include "revisit/recognition/place_index.h"

namespace revisit {
namespace {

constexpr int64_t kMaxPairs = int64_t{1} << 27;  // 1 GB of ballots
constexpr int64_t kMaxPoints = 1000;
constexpr uint64_t kDrawSeed = 1;

class PairTruth {
 public:
  PairTruth(const Task& task, const Trajectory& trajectory)
      : task_(task),
        trajectory_(trajectory),
        earlier_(earlier_candidates(trajectory, task.exclusion)),
        later_(later_candidates(trajectory, task.exclusion)) {}

  PairLabel of(int64_t query, int64_t stored) const {
    const PairLabel truth = pair_label(trajectory_, task_.rule, query, stored);
    const bool beyond = stored < earlier_[query] || stored >= later_[query];
    return truth == PairLabel::kCorrect && !beyond ? PairLabel::kIgnored : truth;
  }

  template <class Take>
  void for_each_not_ignored(const TaskQuery& query, Take take) const {
    for (const CandidateRange& range : query.candidates)
      for (int64_t c = range.begin; c < range.end; ++c) {
        const int64_t stored = task_.stored[c];
        const PairLabel truth = of(query.scan, stored);
        if (truth != PairLabel::kIgnored) take(stored, truth);
      }
  }

 private:
  const Task& task_;
  const Trajectory& trajectory_;
  std::vector<int64_t> earlier_, later_;
};

template <class Work>
void in_parallel(int64_t n_queries, int64_t block, const BootstrapOptions& options, Work work) {
  for (int64_t first = 0; first < n_queries; first += block) {
    if (options.stop && options.stop()) throw Interrupted("evaluation of pairs stopped");
    const int64_t end = std::min(first + block, n_queries);
    parallel_for(end - first, options.threads, [&](int64_t item) { work(first + item); });
    if (options.progress) options.progress(end, n_queries);
  }
}

/// Algorithm S of Knuth, The Art of Computer Programming 2: ascending numbers of 0 .. n - 1.
std::vector<int64_t> draw(int64_t wanted, int64_t n) {
  std::mt19937_64 random(kDrawSeed);
  std::vector<int64_t> drawn;
  drawn.reserve(static_cast<size_t>(wanted));
  for (int64_t i = 0; i < n && wanted > 0; ++i) {
    const double uniform = static_cast<double>(random() >> 11) * 0x1p-53;  // [0, 1)
    if (uniform * static_cast<double>(n - i) >= static_cast<double>(wanted)) continue;
    drawn.push_back(i);
    --wanted;
  }
  return drawn;
}

/// Pairs to compare: all correct ones, and the drawn incorrect ones, numbered over all queries.
struct Selection {
  std::vector<int64_t>
      first_incorrect;  // [queries + 1] number of the first incorrect pair of each query
  std::vector<int64_t> first_pair;  // [queries + 1] index of the first compared pair of each query
  std::optional<std::vector<int64_t>> drawn;  // absent: all incorrect pairs
  std::vector<uint32_t> n_correct;

  auto drawn_of(size_t query) const {
    return std::pair(std::lower_bound(drawn->begin(), drawn->end(), first_incorrect[query]),
                     std::lower_bound(drawn->begin(), drawn->end(), first_incorrect[query + 1]));
  }
};

Selection select(const Task& task, const PairTruth& truth, BootstrapOptions options) {
  const size_t n = task.queries.size();
  Selection selection;
  selection.n_correct.resize(n);
  selection.first_incorrect.resize(n + 1);
  options.progress = {};
  in_parallel(static_cast<int64_t>(n), 1024, options, [&](int64_t q) {
    truth.for_each_not_ignored(task.queries[q], [&](int64_t, PairLabel is) {
      is == PairLabel::kCorrect ? ++selection.n_correct[q] : ++selection.first_incorrect[q + 1];
    });
  });
  std::partial_sum(selection.first_incorrect.begin(), selection.first_incorrect.end(),
                   selection.first_incorrect.begin());

  const int64_t n_incorrect = selection.first_incorrect.back();
  const int64_t n_correct =
      std::accumulate(selection.n_correct.begin(), selection.n_correct.end(), int64_t{0});
  const int64_t wanted = n_correct * task.negatives_per_positive;
  if (task.negatives_per_positive > 0 && wanted < n_incorrect)
    selection.drawn = draw(wanted, n_incorrect);

  selection.first_pair.resize(n + 1);
  for (size_t q = 0; q < n; ++q) {
    int64_t compared = selection.first_incorrect[q + 1] - selection.first_incorrect[q];
    if (selection.drawn) {
      const auto [begin, end] = selection.drawn_of(q);
      compared = end - begin;
    }
    selection.first_pair[q + 1] = selection.first_pair[q] + compared + selection.n_correct[q];
  }
  if (selection.first_pair.back() > kMaxPairs)
    throw UsageError("task ", task.name, ": ", selection.first_pair.back(),
                     " pairs to compare, more than ", kMaxPairs,
                     "; use fewer scans, e.g. every 2nd, or a protocol that decides on queries");
  return selection;
}

using FloatBallot = Ballot<float>;

/// Needs ascending candidates.
std::vector<double> similarities_of(int64_t scan, const std::vector<int64_t>& candidates,
                                    const PlaceIndex& index) {
  std::vector<CandidateRange> ranges;
  for (const int64_t candidate : candidates)
    if (!ranges.empty() && ranges.back().end == candidate)
      ++ranges.back().end;
    else
      ranges.push_back({candidate, candidate + 1});
  std::vector<double> of_scan(static_cast<size_t>(index.size()), -1), similarities;
  const Match match =
      index.best(index.descriptor(scan), ranges, {.k = static_cast<int>(candidates.size())});
  for (size_t i = 0; i < match.ranks.size(); ++i)
    of_scan[static_cast<size_t>(match.ranks[i])] = match.similarities[i];
  for (const int64_t candidate : candidates)
    similarities.push_back(of_scan[static_cast<size_t>(candidate)]);
  return similarities;
}

Ballots<float> compare(const Task& task, const PairTruth& truth, const Selection& selection,
                       const PlaceIndex& index, const BootstrapOptions& options) {
  Ballots<float> ballots;
  ballots.positives = selection.n_correct;
  ballots.by_score.resize(static_cast<size_t>(selection.first_pair.back()));
  in_parallel(static_cast<int64_t>(task.queries.size()), 64, options, [&](int64_t q) {
    const TaskQuery& query = task.queries[q];
    std::vector<int64_t> candidates;
    std::vector<uint32_t> marks;
    std::vector<int64_t>::const_iterator next, end;
    if (selection.drawn) std::tie(next, end) = selection.drawn_of(q);
    int64_t number = selection.first_incorrect[q];
    truth.for_each_not_ignored(query, [&](int64_t stored, PairLabel is) {
      if (is == PairLabel::kIncorrect && selection.drawn) {
        if (next == end || *next != number++) return;
        ++next;
      }
      candidates.push_back(stored);
      marks.push_back(
          static_cast<uint32_t>(q) << FloatBallot::kQueryShift |
          (is == PairLabel::kCorrect ? FloatBallot::kCorrect | FloatBallot::kPositive : 0));
    });
    if (candidates.empty()) return;
    const std::vector<double> similarities = similarities_of(query.scan, candidates, index);
    for (size_t i = 0; i < candidates.size(); ++i)
      ballots.by_score[selection.first_pair[q] + static_cast<int64_t>(i)] = {
          static_cast<float>(similarities[i]), marks[i]};
  });
  ballots.sort();
  return ballots;
}

ScoreHistogram histogram_of(const Ballots<float>& ballots) {
  ScoreHistogram histogram;
  if (ballots.by_score.empty()) return histogram;
  const double low = ballots.by_score.back().score, high = ballots.by_score.front().score;
  histogram.low = low;
  histogram.width = (high > low ? high - low : 1e-3) / ScoreHistogram::kBins;
  for (const FloatBallot& ballot : ballots.by_score) {
    const auto bin = static_cast<int>((ballot.score - low) / histogram.width);
    ++(ballot.correct() ? histogram.of_correct
                        : histogram.of_incorrect)[std::clamp(bin, 0, ScoreHistogram::kBins - 1)];
  }
  return histogram;
}

void check(const Task& task, const Trajectory& trajectory, const Descriptors& descriptors,
           const BootstrapOptions& options) {
  if (!task.decides_on_pairs) throw Error("task ", task.name, " decides on queries, not on pairs");
  need_distances(trajectory, task.rule.distance, "task " + task.name);
  if (options.threads < 1)
    throw UsageError("threads: expected at least 1, found ", options.threads);
  if (descriptors.case1.n != trajectory.size())
    throw Error("task ", task.name, ": descriptors of ", descriptors.case1.n, " scans, of ",
                trajectory.size());
  check_finite(descriptors);
}

}  // namespace

TaskResult evaluate_pairs(const Task& task, const Trajectory& trajectory,
                          const Descriptors& descriptors, const BootstrapOptions& options) {
  check(task, trajectory, descriptors, options);
  const PairTruth truth(task, trajectory);
  const Selection selection = select(task, truth, options);
  Comparison comparison = descriptors.comparison;
  comparison.relative_yaw = nullptr;
  PlaceIndex index(descriptors.case1.d, std::move(comparison));
  for (int64_t scan = 0; scan < descriptors.case1.n; ++scan)
    index.add_view(descriptors.case1.row(scan));
  const Ballots<float> ballots = compare(task, truth, selection, index, options);

  TaskResult result;
  result.score = Score::kSimilarity;
  result.summary = summary_of(ballots);
  result.summary.recall_at_1 = kNotComputed;
  result.summary.n_pairs = static_cast<int64_t>(ballots.by_score.size());
  for (size_t q = 0; q < task.queries.size(); ++q) {
    result.summary.n_queries += selection.first_pair[q + 1] > selection.first_pair[q];
    result.summary.n_positives += selection.n_correct[q] > 0;
    result.summary.n_correct_pairs += selection.n_correct[q];
  }
  if (options.resamples > 0) {
    result.intervals = resample(ballots, options);
    std::tie(result.n_blocks, result.n_positive_blocks) =
        count_blocks(options, [&](size_t query) { return selection.n_correct[query] > 0; });
    result.intervals->recall_at_1 = {kNotComputed, kNotComputed};
  }
  result.curve = curve_of(ballots, kMaxPoints);
  result.histogram = histogram_of(ballots);
  return result;
}

}  // namespace revisit
