#include "revisit/evaluation/precision_recall.h"

#include <algorithm>
#include <cmath>
#include <iterator>
#include <random>
#include <set>

#include "ballots.h"
#include "revisit/base/error.h"
#include "revisit/engine/parallel_for.h"

namespace revisit {
std::vector<MatchLabel> label_matches(const std::vector<Match>& matches, const Task& task,
                                      const Trajectory& trajectory, const MatchRule& rule) {
  need_distances(trajectory, rule.distance, "judging matches");
  if (matches.size() != task.queries.size())
    throw Error("task ", task.name, " has ", task.queries.size(), " queries but ", matches.size(),
                " matches were given");
  std::vector<MatchLabel> labels(matches.size());
  for (size_t i = 0; i < matches.size(); ++i) {
    const TaskQuery& query = task.queries[i];
    if (matches[i].query != query.scan || matches[i].ranks.empty())
      throw Error("match ", i, " does not answer query ", i, " of task ", task.name, " (scan ",
                  query.scan, ")");
    const auto has_best = [&](const CandidateRange& range) {
      const auto first = task.stored.begin();
      return std::find(first + range.begin, first + range.end, matches[i].ranks[0]) !=
             first + range.end;
    };
    if (std::ranges::none_of(query.candidates, has_best))
      throw Error("match ", i, " of task ", task.name, ": scan ", matches[i].ranks[0],
                  " is no candidate of the query, scan ", query.scan);
    labels[i].score = matches[i].score;
    const PairLabel best = pair_label(trajectory, rule, query.scan, matches[i].ranks[0]);
    labels[i].correct = best == PairLabel::kCorrect;
    labels[i].ignored = best == PairLabel::kIgnored;
    for (const CandidateRange& range : query.candidates)
      for (int64_t c = range.begin; c < range.end && !labels[i].positive; ++c)
        labels[i].positive =
            pair_label(trajectory, rule, query.scan, task.stored.at(c)) == PairLabel::kCorrect;
  }
  return labels;
}

Ballots<double> ballots_of(const std::vector<MatchLabel>& labels, bool rejected_only) {
  using B = Ballot<double>;
  Ballots<double> ballots;
  ballots.rejected_only = rejected_only;
  for (const MatchLabel& verdict : labels) {
    if (std::isnan(verdict.score)) throw Error("labels: a score is not a number");
    if (verdict.correct && !verdict.positive)
      throw Error("labels: a query is marked correct but has no true match");
    if (verdict.correct && verdict.ignored)
      throw Error("labels: a match is both correct and ignored");
    // Queries with an ignored match are positives only if missing means rejecting.
    const bool positive = verdict.positive && (rejected_only || !verdict.ignored);
    const auto query = static_cast<uint32_t>(ballots.positives.size());
    ballots.by_score.push_back(
        {verdict.score, query << B::kQueryShift | (verdict.correct ? B::kCorrect : 0) |
                            (positive ? B::kPositive : 0) | (verdict.ignored ? B::kIgnored : 0)});
    ballots.positives.push_back(positive);
    ballots.sought.push_back(verdict.positive);
  }
  ballots.sort();
  return ballots;
}

std::vector<PrPoint> precision_recall(const std::vector<MatchLabel>& labels, bool rejected_only) {
  return curve_of(ballots_of(labels, rejected_only));
}

PrSummary summarize(const std::vector<MatchLabel>& labels, bool rejected_only) {
  PrSummary summary = summary_of(ballots_of(labels, rejected_only));
  summary.n_queries = static_cast<int64_t>(labels.size());
  summary.n_positives =
      std::count_if(labels.begin(), labels.end(), [](const MatchLabel& v) { return v.positive; });
  return summary;
}

namespace {

constexpr int kLanes = 8;

void check(const BootstrapOptions& options, size_t n_queries) {
  if (options.blocks.size() != n_queries)
    throw UsageError("bootstrap: expected the block of each of ", n_queries, " queries, found ",
                     options.blocks.size());
  if (options.resamples < 1)
    throw UsageError("bootstrap: expected at least 1 resample, found ", options.resamples);
  if (options.threads < 1)
    throw UsageError("bootstrap: expected at least 1 thread, found ", options.threads);
  if (!(options.confidence > 0 && options.confidence < 1))
    throw UsageError("bootstrap: expected a confidence between 0 and 1, found ",
                     options.confidence);
}

struct Blocks {
  std::vector<int64_t> names;
  std::vector<size_t> of_query;

  explicit Blocks(const std::vector<int64_t>& given) : names(given) {
    std::ranges::sort(names);
    names.erase(std::unique(names.begin(), names.end()), names.end());
    for (const int64_t block : given)
      of_query.push_back(
          static_cast<size_t>(std::ranges::lower_bound(names, block) - names.begin()));
  }
};

/// Draws the blocks of resample `number`, which depend only on the seed and `number`.
template <class Take>
void draw(uint64_t seed, int number, uint64_t n_blocks, Take take) {
  std::seed_seq mixed{static_cast<uint32_t>(seed), static_cast<uint32_t>(seed >> 32),
                      static_cast<uint32_t>(number)};
  std::mt19937_64 random(mixed);
  // std::uniform_int_distribution differs between standard libraries.
  for (uint64_t i = 0; i < n_blocks; ++i) take(((random() >> 32) * n_blocks) >> 32);
}

/// Quantile of sorted values with linear interpolation (type 7 of Hyndman and Fan).
double quantile(const std::vector<double>& sorted, double share) {
  const double at = share * static_cast<double>(sorted.size() - 1);
  const auto below = static_cast<size_t>(at);
  const size_t above = std::min(below + 1, sorted.size() - 1);
  return sorted[below] + (at - static_cast<double>(below)) * (sorted[above] - sorted[below]);
}

std::array<double, 2> percentiles(const std::vector<PrSummary>& resamples,
                                  double PrSummary::*member, double confidence) {
  std::vector<double> values;
  for (const PrSummary& metrics : resamples)
    if (!std::isnan(metrics.*member)) values.push_back(metrics.*member);
  if (values.empty()) return {kNotComputed, kNotComputed};
  std::sort(values.begin(), values.end());
  return {quantile(values, (1 - confidence) / 2), quantile(values, (1 + confidence) / 2)};
}

}  // namespace

std::pair<int64_t, int64_t> count_blocks(const BootstrapOptions& options,
                                         const std::function<bool(size_t query)>& is_positive) {
  std::set<int64_t> all, positive;
  for (size_t query = 0; query < options.blocks.size(); ++query) {
    all.insert(options.blocks[query]);
    if (is_positive(query)) positive.insert(options.blocks[query]);
  }
  return {std::ssize(all), std::ssize(positive)};
}

std::vector<int64_t> blocks_of(const Task& task, const Trajectory& trajectory,
                               const std::optional<Exclusion>& length) {
  std::vector<int64_t> of_scan;
  if (!length && task.rule.distance == Distance::kPlace) {
    for (size_t row = 0; row < trajectory.places.size(); ++row)
      of_scan.push_back(std::ranges::find(trajectory.places, trajectory.places[row]) -
                        trajectory.places.begin());
  } else {
    const Exclusion block =
        length.value_or(trajectory.positions.empty() ? kBlockOfFrames : kBlockOfPath);
    const bool single = block.kind == Exclusion::Kind::kNone;
    if (!single && !(block.amount > 0))
      throw UsageError("block: expected a length above 0, found ", block.amount);
    constexpr double kMaxBlocks = 9e15;  // limit of integers in a double
    for (const double along : distance_along(trajectory, block.kind, "block")) {
      const double at = single ? along : std::floor(along / block.amount);
      if (!(std::abs(at) < kMaxBlocks))
        throw UsageError("block: ", to_string(block), " is too short for a drive of ", along);
      of_scan.push_back(static_cast<int64_t>(at));
    }
  }
  std::vector<int64_t> blocks;
  for (const TaskQuery& query : task.queries)
    blocks.push_back(of_scan.at(static_cast<size_t>(query.scan)));
  return blocks;
}

template <class Score>
PrIntervals resample(const Ballots<Score>& ballots, const BootstrapOptions& options) {
  const size_t n_queries = ballots.positives.size();
  check(options, n_queries);
  const Blocks blocks(options.blocks);
  constexpr std::array<double, 2> kNone{kNotComputed, kNotComputed};
  if (blocks.names.size() < 2) return {kNone, kNone, kNone, kNone, kNone};
  const int n_batches = (options.resamples + kLanes - 1) / kLanes;
  std::vector<PrSummary> resamples(static_cast<size_t>(n_batches) * kLanes);
  // Only this thread calls `stop`, between rounds; long ones, because threads wait at their ends.
  const int round = 8 * options.threads;
  for (int first = 0; first < n_batches; first += round) {
    if (options.stop && options.stop()) throw Interrupted("bootstrap stopped");
    const int end = std::min(n_batches, first + round);
    parallel_for(end - first, options.threads, [&](int64_t item) {
      const int batch = first + static_cast<int>(item);
      Weights<kLanes> drawn(blocks.names.size()), weights(n_queries);
      for (int lane = 0; lane < kLanes; ++lane)
        draw(options.seed, batch * kLanes + lane, blocks.names.size(),
             [&](uint64_t block) { ++drawn[block][static_cast<size_t>(lane)]; });
      for (size_t query = 0; query < n_queries; ++query)
        weights[query] = drawn[blocks.of_query[query]];
      const auto measured = measure<kLanes>(ballots, weights);
      std::copy(measured.begin(), measured.end(), resamples.begin() + batch * kLanes);
    });
  }
  resamples.resize(static_cast<size_t>(options.resamples));
  const auto interval = [&](double PrSummary::*member) {
    return percentiles(resamples, member, options.confidence);
  };
  return {interval(&PrSummary::f1_max), interval(&PrSummary::average_precision),
          interval(&PrSummary::recall_at_1), interval(&PrSummary::max_recall_at_precision_1),
          interval(&PrSummary::extended_precision)};
}

template PrIntervals resample(const Ballots<float>&, const BootstrapOptions&);
template PrIntervals resample(const Ballots<double>&, const BootstrapOptions&);

PrIntervals bootstrap(const std::vector<MatchLabel>& labels, bool rejected_only,
                      const BootstrapOptions& options) {
  return resample(ballots_of(labels, rejected_only), options);
}

}  // namespace revisit
