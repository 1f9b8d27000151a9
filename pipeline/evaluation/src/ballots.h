#pragma once

#include <algorithm>
#include <array>
#include <cstdint>
#include <vector>

#include "revisit/base/error.h"
#include "revisit/evaluation/precision_recall.h"

namespace revisit {

template <class Score>
struct Ballot {
  static constexpr uint32_t kCorrect = 1, kPositive = 2, kIgnored = 4;
  static constexpr int kQueryShift = 3;

  Score score = 0;
  uint32_t mark = 0;  // (query << 3) | flags

  uint32_t query() const { return mark >> kQueryShift; }
  bool correct() const { return mark & kCorrect; }
  bool positive() const { return mark & kPositive; }
  bool ignored() const { return mark & kIgnored; }
};

template <class Score>
struct Ballots {
  std::vector<Ballot<Score>> by_score;  // highest first; ties ordered by mark
  std::vector<uint32_t> positives;
  /// Like `positives`, for recall@1, where ignored matches are misses; empty: equal to `positives`.
  std::vector<uint32_t> sought;
  bool rejected_only = false;

  void sort() {
    std::sort(by_score.begin(), by_score.end(), [](const auto& a, const auto& b) {
      return a.score != b.score ? a.score > b.score : a.mark < b.mark;
    });
  }
  bool ends_tie(size_t i) const {
    return i + 1 == by_score.size() || by_score[i + 1].score != by_score[i].score;
  }
};

/// [query][resample]
template <int kLanes>
using Weights = std::vector<std::array<uint32_t, kLanes>>;

/// Computes metrics of kLanes resamples in one pass, without counts. The weights of a resample sum
/// to less than 2^32.
template <int kLanes, class Score>
std::array<PrSummary, kLanes> measure(const Ballots<Score>& ballots,
                                      const Weights<kLanes>& weights) {
  using Counts = std::array<uint32_t, kLanes>;
  Counts positives{}, sought{}, tp{}, fp{}, accepted_positives{};
  const auto add = [](Counts& to, const Counts& weight) {
    for (int lane = 0; lane < kLanes; ++lane) to[lane] += weight[lane];
  };
  for (size_t q = 0; q < ballots.positives.size(); ++q)
    for (int lane = 0; lane < kLanes; ++lane)
      positives[lane] += weights[q][lane] * ballots.positives[q];
  const auto& of_recall = ballots.sought.empty() ? ballots.positives : ballots.sought;
  for (size_t q = 0; q < of_recall.size(); ++q)
    for (int lane = 0; lane < kLanes; ++lane) sought[lane] += weights[q][lane] * of_recall[q];

  struct Lane {
    double last_recall = 0, first_precision = 0, f1_max = -1, average_precision = 0,
           max_recall_at_precision_1 = 0;
    int64_t f1_max_at = -1;
    bool started = false;
  };
  std::array<Lane, kLanes> lanes;
  int n_started = 0;
  const auto look = [&](int i, size_t at) {
    Lane& lane = lanes[i];
    const double t = tp[i], f = fp[i], n = positives[i];
    if (t + f == 0) return;
    const double precision = t / (t + f);
    if (!lane.started) {
      lane.started = true;
      lane.first_precision = precision;
      ++n_started;
    }
    const double fn = n - (ballots.rejected_only ? static_cast<double>(accepted_positives[i]) : t);
    const double recall = t > 0 ? t / (t + fn) : 0;
    const double f1 = t > 0 ? 2 * t / (2 * t + f + fn) : 0;
    if (f1 > lane.f1_max) {
      lane.f1_max = f1;
      lane.f1_max_at = static_cast<int64_t>(at);
    }
    lane.average_precision += (recall - lane.last_recall) * precision;
    lane.last_recall = recall;
    if (f == 0) lane.max_recall_at_precision_1 = recall;
  };

  bool recall_changed = false;  // otherwise precision and F1 cannot have increased
  for (size_t at = 0; at < ballots.by_score.size(); ++at) {
    const Ballot<Score>& ballot = ballots.by_score[at];
    const Counts& weight = weights[ballot.query()];
    if (ballot.correct())
      add(tp, weight);
    else if (!ballot.ignored())
      add(fp, weight);
    if (ballot.positive()) {
      add(accepted_positives, weight);
      recall_changed = true;
    }
    if (!ballots.ends_tie(at) || (!recall_changed && n_started == kLanes)) continue;
    for (int i = 0; i < kLanes; ++i) look(i, at);
    recall_changed = false;
  }

  std::array<PrSummary, kLanes> summaries;
  for (int i = 0; i < kLanes; ++i) {
    PrSummary& summary = summaries[i];
    if (sought[i] > 0) summary.recall_at_1 = static_cast<double>(tp[i]) / sought[i];
    if (positives[i] == 0) continue;
    const Lane& lane = lanes[i];
    summary.f1_max = std::max(lane.f1_max, 0.0);
    if (lane.f1_max_at >= 0)
      summary.f1_max_threshold = static_cast<double>(ballots.by_score[lane.f1_max_at].score);
    summary.average_precision = lane.average_precision;
    summary.max_recall_at_precision_1 = lane.max_recall_at_precision_1;
    summary.extended_precision = (lane.first_precision + lane.max_recall_at_precision_1) / 2;
  }
  return summaries;
}

/// `max_points` > 0 limits the curve to about that number of points, evenly spaced in recall:
/// thresholds that add a correct match, and the last one.
template <class Score>
std::vector<PrPoint> curve_of(const Ballots<Score>& ballots, int64_t max_points = 0) {
  // A query whose match is ignored may have a correct match among its candidates.
  const auto is_negative = [&](const Ballot<Score>& ballot) {
    return !ballot.positive() && !(ballot.ignored() && ballots.sought[ballot.query()] > 0);
  };
  int64_t n_positives = 0, n_correct = 0, n_negatives = 0;
  for (const auto& ballot : ballots.by_score) {
    n_positives += ballot.positive();
    n_correct += ballot.correct();
    n_negatives += is_negative(ballot);
  }
  std::vector<PrPoint> curve;
  int64_t tp = 0, fp = 0, accepted_positives = 0, accepted_negatives = 0, next_tp = 1;
  for (size_t at = 0; at < ballots.by_score.size(); ++at) {
    const Ballot<Score>& ballot = ballots.by_score[at];
    tp += ballot.correct();
    fp += !ballot.correct() && !ballot.ignored();
    accepted_positives += ballot.positive();
    accepted_negatives += is_negative(ballot);
    if (!ballots.ends_tie(at)) continue;
    const bool last = at + 1 == ballots.by_score.size();
    if (max_points > 0 && tp < next_tp && !last) continue;
    next_tp = tp + std::max<int64_t>(1, max_points > 0 ? n_correct / max_points : 0);

    const int64_t found = ballots.rejected_only ? accepted_positives : tp;
    PrPoint point{static_cast<double>(ballot.score), tp, fp, n_positives - found,
                  n_negatives - accepted_negatives};
    const auto share = [](int64_t part, int64_t whole) {
      return part ? static_cast<double>(part) / static_cast<double>(whole) : 0;
    };
    point.precision = tp + fp ? share(tp, tp + fp) : kNotComputed;
    point.recall = n_positives ? share(tp, tp + point.fn) : kNotComputed;
    point.f1 = n_positives ? share(2 * tp, 2 * tp + fp + point.fn) : kNotComputed;
    curve.push_back(point);
  }
  return curve;
}

/// The caller sets the counts of queries.
template <class Score>
PrSummary summary_of(const Ballots<Score>& ballots) {
  return measure<1>(ballots, Weights<1>(ballots.positives.size(), {1}))[0];
}

Ballots<double> ballots_of(const std::vector<MatchLabel>& labels, bool rejected_only);

template <class Score>
PrIntervals resample(const Ballots<Score>& ballots, const BootstrapOptions& options);
extern template PrIntervals resample(const Ballots<float>&, const BootstrapOptions&);
extern template PrIntervals resample(const Ballots<double>&, const BootstrapOptions&);

}  // namespace revisit
