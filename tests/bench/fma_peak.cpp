// The most multiply-adds that this CPU does, on 1 to N threads at once, as JSON:
//   revisit_fma_peak 2
#include <algorithm>
#include <atomic>
#include <chrono>
#include <cstdio>
#include <string>
#include <thread>
#include <vector>

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "fma_peak.cpp"
#include <hwy/foreach_target.h>
// After foreach_target.h.
#include <hwy/highway.h>

HWY_BEFORE_NAMESPACE();
namespace revisit::bench::HWY_NAMESPACE {

namespace hn = hwy::HWY_NAMESPACE;

/// Independent sums: more than latency times throughput of any CPU's multiply-add.
constexpr int kSums = 12;

/// [floating-point operations] done; `sink` keeps the compiler from leaving them out.
double multiply_add(int64_t rounds, float* sink) {
  const hn::ScalableTag<float> d;
  hn::Vec<decltype(d)> sums[kSums];
  const auto factor = hn::Set(d, *sink), addend = hn::Set(d, *sink * 1e-7F);
#pragma GCC unroll 12
  for (int i = 0; i < kSums; ++i) sums[i] = hn::Set(d, *sink + static_cast<float>(i));
  for (int64_t round = 0; round < rounds; ++round) {
#pragma GCC unroll 12
    for (int i = 0; i < kSums; ++i) sums[i] = hn::MulAdd(sums[i], factor, addend);
  }
  auto all = hn::Zero(d);
#pragma GCC unroll 12
  for (int i = 0; i < kSums; ++i) all = hn::Add(all, sums[i]);
  *sink = hn::GetLane(hn::SumOfLanes(d, all)) > 0 ? 1.0F : 0.5F;
  return 2.0 * static_cast<double>(rounds) * kSums * static_cast<double>(hn::Lanes(d));
}

}  // namespace revisit::bench::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace revisit::bench {

HWY_EXPORT(multiply_add);

/// [GFLOP/s] of the fastest of several short runs, all threads starting together.
double peak(int threads) {
  using Clock = std::chrono::steady_clock;
  constexpr int64_t kRounds = 200000;
  constexpr int kRepeat = 60;
  double best = 0;
  for (int repeat = 0; repeat < kRepeat; ++repeat) {
    std::this_thread::sleep_for(std::chrono::milliseconds(5));
    std::atomic<int> ready = 0;
    std::vector<Clock::time_point> begin(static_cast<size_t>(threads)), end(begin);
    std::vector<double> operations(static_cast<size_t>(threads));
    std::vector<std::thread> workers;
    for (size_t i = 0; i < begin.size(); ++i)
      workers.emplace_back([&, i] {
        float sink = 1;
        ++ready;
        while (ready < threads) std::this_thread::yield();
        begin[i] = Clock::now();
        operations[i] = HWY_DYNAMIC_DISPATCH(multiply_add)(kRounds, &sink);
        end[i] = Clock::now();
      });
    for (std::thread& worker : workers) worker.join();
    double sum = 0;
    for (const double count : operations) sum += count;
    const std::chrono::duration<double> time =
        *std::max_element(end.begin(), end.end()) - *std::min_element(begin.begin(), begin.end());
    best = std::max(best, sum / time.count() * 1e-9);
  }
  return best;
}

}  // namespace revisit::bench

int main(int argc, char** argv) {
  const int most = argc > 1 ? std::stoi(argv[1]) : 1;
  std::printf("{\"instructions\": \"%s\", \"gflops\": {",
              hwy::TargetName(hwy::SupportedAndGeneratedTargets()[0]));
  for (int threads = 1; threads <= most; ++threads)
    std::printf("%s\"%d\": %.1f", threads > 1 ? ", " : "", threads, revisit::bench::peak(threads));
  std::printf("}}\n");
}
#endif  // HWY_ONCE
