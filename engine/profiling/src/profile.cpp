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

class LayerClock : public engine::StepObserver {
 public:
  explicit LayerClock(size_t layers) : samples_(layers) {}
  /// Starts a pass with zero sums, because a layer can have several steps (kernel and reorders).
  void start_pass() {
    for (auto& layer : samples_) layer.push_back(0);
  }
  void before(size_t) override { start_ = Clock::now(); }
  void after(size_t layer) override { samples_[layer].back() += milliseconds_since(start_); }
  const std::vector<std::vector<double>>& samples() const { return samples_; }

 private:
  std::vector<std::vector<double>> samples_;  // [layer][pass]; 0 without steps
  Clock::time_point start_;
};

/// Rank i, from 0, of the lower bound: the largest i such that sample i of n exceeds the median
/// with a probability of at most 0.5 %. This is the probability of at most i heads in n tosses
/// (David and Nagaraja: Order Statistics, 7.1). Returns 0 if even the minimum exceeds it more
/// often.
size_t rank_below_median(size_t n) {
  constexpr double kOnOneSide = 0.005;
  const auto tosses = static_cast<double>(n);
  double probability = 0;
  size_t heads = 0;
  for (; heads < n; ++heads) {
    const auto k = static_cast<double>(heads);
    probability += std::exp(std::lgamma(tosses + 1) - std::lgamma(k + 1) -
                            std::lgamma(tosses - k + 1) - tosses * std::log(2.0));
    if (probability > kOnOneSide) break;
  }
  return heads > 0 ? heads - 1 : 0;
}

}  // namespace

Timing summarize(std::vector<double> samples) {
  std::sort(samples.begin(), samples.end());
  const size_t n = samples.size();
  const auto rank95 = static_cast<size_t>(std::ceil(0.95 * static_cast<double>(n)));
  const size_t low = rank_below_median(n);
  return {samples.front(), (samples[(n - 1) / 2] + samples[n / 2]) / 2,
          samples[std::max<size_t>(rank95, 1) - 1], samples[low], samples[n - 1 - low]};
}

Profile profile(engine::Run& run, const ProfileOptions& options) {
  const auto stopped = [&] { return options.stop && options.stop(); };
  for (int i = 0; i < options.warmup && !stopped(); ++i) run.forward();

  const size_t n_layers = run.plan().layers().size();
  LayerClock clock(n_layers);
  std::vector<double> totals, sums;
  for (int pass = 0; pass < std::max(options.repeat, 1) && !(pass > 0 && stopped()); ++pass) {
    const Clock::time_point start = Clock::now();
    run.forward();
    totals.push_back(milliseconds_since(start));

    clock.start_pass();
    run.forward(clock);
    sums.push_back(
        std::accumulate(clock.samples().begin(), clock.samples().end(), 0.0,
                        [](double sum, const auto& layer) { return sum + layer.back(); }));
  }

  Profile result;
  result.passes = static_cast<int>(totals.size());
  for (const auto& samples : clock.samples()) result.layers.push_back(summarize(samples));
  result.layer_sum = summarize(std::move(sums));
  result.total = summarize(std::move(totals));
  return result;
}

}  // namespace revisit::profiling
