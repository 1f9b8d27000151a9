#include "revisit/profiling/profile.h"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <numeric>

namespace revisit::profiling {
namespace {

using Clock = std::chrono::steady_clock;

double milliseconds_since(Clock::time_point start) {
  return std::chrono::duration<double, std::milli>(Clock::now() - start).count();
}

/// Probability of `heads` heads in n tosses, that of `heads` of n samples below the median.
double probability_of_heads(size_t heads, size_t n) {
  const auto k = static_cast<double>(heads), tosses = static_cast<double>(n);
  return std::exp(std::lgamma(tosses + 1) - std::lgamma(k + 1) - std::lgamma(tosses - k + 1) -
                  tosses * std::log(2.0));
}

struct MedianRank {
  size_t rank;        // from 0, of the lower bound
  double confidence;  // that the median is between it and its twin from the end
};

/// The largest rank such that its sample exceeds the median with a probability of at most 0.5 %
/// (David and Nagaraja: Order Statistics, 7.1), or 0 if even the minimum exceeds it more often.
MedianRank rank_below_median(size_t n) {
  constexpr double kOnOneSide = 0.005;
  double outside = probability_of_heads(0, n);
  size_t rank = 0;
  for (double next = outside; rank + 1 < n; ++rank) {
    next += probability_of_heads(rank + 1, n);
    if (next > kOnOneSide) break;
    outside = next;
  }
  return {rank, 1 - 2 * outside};
}

}  // namespace

Timing summarize(std::vector<double> samples) {
  std::sort(samples.begin(), samples.end());
  const size_t n = samples.size();
  const auto rank95 = static_cast<size_t>(std::ceil(0.95 * static_cast<double>(n)));
  const auto [low, confidence] = rank_below_median(n);
  return {samples.front(),
          (samples[(n - 1) / 2] + samples[n / 2]) / 2,
          samples[std::max<size_t>(rank95, 1) - 1],
          samples[low],
          samples[n - 1 - low],
          std::max(confidence, 0.0)};
}

Profile profile(engine::Run& run, int warmup, int repeat, const std::function<bool()>& stop) {
  const auto stopped = [&] { return stop && stop(); };
  for (int i = 0; i < warmup && !stopped(); ++i) run.forward();

  const size_t n_layers = run.plan().layers().size();
  std::vector<std::vector<double>> layers(n_layers);  // [layer][pass]; 0 without steps
  std::vector<double> totals, sums;
  for (int pass = 0; pass < std::max(repeat, 1) && !(pass > 0 && stopped()); ++pass) {
    const Clock::time_point start = Clock::now();
    run.forward();
    totals.push_back(milliseconds_since(start));

    for (auto& layer : layers) layer.push_back(0);
    Clock::time_point step;
    run.forward([&](size_t layer, bool done) {
      if (done)
        layers[layer].back() += milliseconds_since(step);
      else
        step = Clock::now();
    });
    sums.push_back(
        std::accumulate(layers.begin(), layers.end(), 0.0,
                        [](double sum, const auto& layer) { return sum + layer.back(); }));
  }

  Profile result;
  result.passes = static_cast<int>(totals.size());
  for (const auto& samples : layers) result.layers.push_back(summarize(samples));
  result.layer_sum = summarize(std::move(sums));
  result.total = summarize(std::move(totals));
  return result;
}

}  // namespace revisit::profiling
