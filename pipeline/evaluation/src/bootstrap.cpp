#include "revisit/evaluation/bootstrap.h"

#include <cmath>
#include <random>

#include "ballots.h"
#include "revisit/engine/parallel_for.h"

namespace revisit::pipeline {
namespace {

constexpr int kLanes = 8;  // resamples that share one pass over the ballots

void check(const BootstrapOptions& options) {
  if (options.resamples < 1)
    throw UsageError("bootstrap: expected at least 1 resample, found ", options.resamples);
  if (options.threads < 1)
    throw UsageError("bootstrap: expected at least 1 thread, found ", options.threads);
  if (!(options.confidence > 0 && options.confidence < 1))
    throw UsageError("bootstrap: expected a confidence between 0 and 1, found ",
                     options.confidence);
}

/// How often resample `number` draws each query. It depends on nothing but the seed and `number`.
template <class Take>
void draw(uint64_t seed, int number, uint64_t n_queries, Take take) {
  std::seed_seq mixed{static_cast<uint32_t>(seed), static_cast<uint32_t>(seed >> 32),
                      static_cast<uint32_t>(number)};
  std::mt19937_64 random(mixed);
  // Not uniform_int_distribution: its results differ between standard libraries.
  for (uint64_t i = 0; i < n_queries; ++i) take(((random() >> 32) * n_queries) >> 32);
}

/// The quantile of sorted values, linear between them (type 7 of Hyndman and Fan).
double quantile(const std::vector<double>& sorted, double share) {
  const double at = share * static_cast<double>(sorted.size() - 1);
  const auto below = static_cast<size_t>(at);
  const size_t above = std::min(below + 1, sorted.size() - 1);
  return sorted[below] + (at - static_cast<double>(below)) * (sorted[above] - sorted[below]);
}

Interval percentiles(const std::vector<Metrics>& resamples, double Metrics::*member,
                     double confidence) {
  std::vector<double> values;
  for (const Metrics& metrics : resamples)
    if (!std::isnan(metrics.*member)) values.push_back(metrics.*member);
  if (values.empty()) return {kNotComputed, kNotComputed};
  std::sort(values.begin(), values.end());
  return {quantile(values, (1 - confidence) / 2), quantile(values, (1 + confidence) / 2)};
}

}  // namespace

template <class Score>
PrIntervals resample(const Ballots<Score>& ballots, const BootstrapOptions& options) {
  check(options);
  const size_t n_queries = ballots.positives.size();
  const int n_batches = (options.resamples + kLanes - 1) / kLanes;
  std::vector<Metrics> resamples(static_cast<size_t>(n_batches) * kLanes);
  // Rounds, so that `stop` is asked from this thread; long ones, as threads wait at their ends.
  const int round = 8 * options.threads;
  for (int first = 0; first < n_batches; first += round) {
    if (options.stop && options.stop()) throw Interrupted("bootstrap stopped");
    const int end = std::min(n_batches, first + round);
    parallel_for(end - first, options.threads, [&](int64_t item) {
      const int batch = first + static_cast<int>(item);
      Weights<kLanes> weights(n_queries);
      for (int lane = 0; lane < kLanes; ++lane)
        draw(options.seed, batch * kLanes + lane, n_queries,
             [&](uint64_t query) { ++weights[query][static_cast<size_t>(lane)]; });
      const auto measured = measure<kLanes>(ballots, weights);
      std::copy(measured.begin(), measured.end(), resamples.begin() + batch * kLanes);
    });
  }
  resamples.resize(static_cast<size_t>(options.resamples));
  const auto interval = [&](double Metrics::*member) {
    return percentiles(resamples, member, options.confidence);
  };
  return {interval(&Metrics::f1_max), interval(&Metrics::average_precision),
          interval(&Metrics::recall_at_1), interval(&Metrics::max_recall_at_precision_1),
          interval(&Metrics::extended_precision)};
}

template PrIntervals resample(const Ballots<float>&, const BootstrapOptions&);
template PrIntervals resample(const Ballots<double>&, const BootstrapOptions&);

PrIntervals bootstrap(const std::vector<Verdict>& verdicts, Missed missed,
                      const BootstrapOptions& options) {
  return resample(ballots_of(verdicts, missed), options);
}

}  // namespace revisit::pipeline
