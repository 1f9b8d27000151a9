#include <sys/mman.h>
#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdlib>
#include <memory>
#include <new>

#include "busy_loops.h"
#include "revisit/engine/machine.h"
#include "revisit/engine/parallel_for.h"
#include "revisit/profiling/profile.h"

namespace revisit::profiling {
namespace {

using Clock = std::chrono::steady_clock;

constexpr double kGiga = 1e9;
constexpr double kPerMs = 1e6;  // operations or bytes per ms at 1 GFLOP/s or GB/s

double seconds_since(Clock::time_point start) {
  return std::chrono::duration<double>(Clock::now() - start).count();
}

/// Durations of runs in which every thread executes `work(run, part)` [s]: at least `least` runs,
/// and more until the time budget ends. Runs below a millisecond often escape interruptions by
/// other programs.
template <class Work>
std::vector<double> seconds_of_runs(int threads, int64_t least, const Work& work) {
  constexpr double kBudget = 0.02;
  std::vector<double> seconds;
  const Clock::time_point start = Clock::now();
  for (int64_t run = 0; run < least || seconds_since(start) < kBudget; ++run) {
    const Clock::time_point begin = Clock::now();
    parallel_for(threads, threads, [&](int64_t part) { work(run, part); });
    seconds.push_back(seconds_since(begin));
  }
  return seconds;
}

void keep(float result) {
  [[maybe_unused]] const volatile float kept = result;
}

double gflops(int threads, int64_t rounds, LoopWork (*multiply)(int64_t)) {
  constexpr int64_t kMinRuns = 5;
  int64_t count_per_thread = 0;
  const std::vector<double> seconds =
      seconds_of_runs(threads, kMinRuns, [&](int64_t, int64_t part) {
        const LoopWork done = multiply(rounds);
        keep(done.result);
        if (part == 0) count_per_thread = done.count;
      });
  return static_cast<double>(count_per_thread * threads) / *std::ranges::min_element(seconds) /
         kGiga;
}

double bf16_gflops(int threads) {
  constexpr int64_t kRounds = 1 << 16, kTileRounds = 1 << 14;
  double most = 0;
  if (engine::has_bf16_instructions()) most = gflops(threads, kRounds, multiply_bf16);
  if (engine::has_bf16_tiles())
    most = std::max(most, gflops(threads, kTileRounds, multiply_bf16_tiles));
  return most;
}

/// Begin of part `i` of `items` floats, cut into `parts` parts of whole kLoopFloats.
int64_t begin_of(int64_t i, int64_t items, int64_t parts) {
  return items / kLoopFloats * i / parts * kLoopFloats;
}

/// Limited for machines with little memory.
int64_t bytes_beyond_caches() {
  constexpr int64_t kLeast = 64 << 20, kMost = 256 << 20;
#ifdef _SC_LEVEL3_CACHE_SIZE
  return std::clamp<int64_t>(4 * sysconf(_SC_LEVEL3_CACHE_SIZE), kLeast, kMost);
#else
  return kLeast;
#endif
}

/// Bandwidth for the first `bytes` of `memory` [GB/s]. A run moves about kMovedBytes bytes: several
/// passes over a small set, or one slice of a large set. For slices the median is used, because
/// some may still be in a cache.
Bandwidth bandwidth(int threads, float* memory, int64_t bytes) {
  constexpr int64_t kMovedBytes = 4 << 20;
  const int64_t floats = bytes / int64_t{sizeof(float)};
  const auto measure = [&](int64_t items, const auto& move) {
    const int64_t slices = std::max<int64_t>(bytes / kMovedBytes, 1);
    const int64_t passes = std::max<int64_t>(kMovedBytes / bytes, 1);
    std::vector<double> seconds =
        seconds_of_runs(threads, 2 * slices, [&](int64_t run, int64_t part) {
          const int64_t begin = begin_of(run % slices, items, slices);
          const int64_t width = begin_of(run % slices + 1, items, slices) - begin;
          const int64_t first = begin_of(part, width, threads);
          const int64_t end = begin_of(part + 1, width, threads);
          for (int64_t pass = 0; pass < passes; ++pass) move(begin + first, end - first);
        });
    const auto rank = slices > 1 ? static_cast<int64_t>(seconds.size() / 2) : 0;
    std::ranges::nth_element(seconds, seconds.begin() + rank);
    const auto moved = static_cast<double>(bytes * passes) / static_cast<double>(slices);
    return moved / seconds[static_cast<size_t>(rank)] / kGiga;
  };
  float* const from = memory;
  float* const to = from + floats / 2;
  return {bytes,
          measure(floats, [&](int64_t first, int64_t n) { keep(read_floats(from + first, n)); }),
          measure(floats / 2,
                  [&](int64_t first, int64_t n) { copy_floats(from + first, to + first, n); })};
}

std::vector<Bandwidth> bandwidths(int threads) {
  constexpr int64_t kSmallest = 64 << 10, kStep = 4;
  const int64_t largest = bytes_beyond_caches();
  const int64_t floats = largest / int64_t{sizeof(float)};
  constexpr size_t kHugePage = size_t{2} << 20;
  const std::unique_ptr<float, decltype(&std::free)> memory(
      static_cast<float*>(std::aligned_alloc(kHugePage, static_cast<size_t>(largest))), std::free);
  if (!memory) throw std::bad_alloc();
#ifdef MADV_HUGEPAGE  // kernels use huge pages, too; without them, address translation takes time
  madvise(memory.get(), static_cast<size_t>(largest), MADV_HUGEPAGE);
#endif
  // First touch places the pages near their thread.
  parallel_for(threads, threads, [&](int64_t part) {
    std::fill(memory.get() + begin_of(part, floats, threads),
              memory.get() + begin_of(part + 1, floats, threads), 0.0F);
  });
  std::vector<Bandwidth> result;
  for (int64_t bytes = kSmallest; bytes < largest; bytes *= kStep)
    result.push_back(bandwidth(threads, memory.get(), bytes));
  result.push_back(bandwidth(threads, memory.get(), largest));
  return result;
}

Bandwidth bandwidth_at(const std::vector<Bandwidth>& measured, int64_t bytes) {
  const auto next = std::ranges::lower_bound(measured, bytes, {}, &Bandwidth::bytes);
  if (next == measured.begin()) return measured.front();
  if (next == measured.end()) return measured.back();
  const Bandwidth &low = *std::prev(next), &high = *next;
  const double share = std::log(static_cast<double>(bytes) / static_cast<double>(low.bytes)) /
                       std::log(static_cast<double>(high.bytes) / static_cast<double>(low.bytes));
  return {bytes, std::lerp(low.read, high.read, share), std::lerp(low.copy, high.copy, share)};
}

}  // namespace

double SpeedLimits::compute_ms(const engine::LayerCost& cost) const {
  const bool bf16 = cost.products == engine::Precision::kBf16 && bf16_gflops > 0;
  return 2 * static_cast<double>(cost.multiplications) / (bf16 ? bf16_gflops : float32_gflops) /
         kPerMs;
}

double SpeedLimits::traffic_ms(const engine::LayerCost& cost) const {
  const Bandwidth here = bandwidth_at(bandwidths, cost.read_bytes + cost.written_bytes);
  const auto both = static_cast<double>(2 * std::min(cost.read_bytes, cost.written_bytes));
  const auto more = static_cast<double>(cost.read_bytes - cost.written_bytes);
  // Writing alone is as slow as copying, because the cache line is read first.
  return (both / here.copy + (more > 0 ? more / here.read : -more / here.copy)) / kPerMs;
}

SpeedLimits measure_speed_limits(int threads) {
  constexpr int64_t kRounds = 1 << 16;
  constexpr int kMaxThreads = 1024;
  if (threads < 1 || threads > kMaxThreads)
    throw UsageError("expected 1 to ", kMaxThreads, " threads, found ", threads);
  SpeedLimits limits;
  limits.threads = threads;
  limits.float32_gflops = gflops(threads, kRounds, multiply_float32);
  limits.bf16_gflops = bf16_gflops(threads);
  limits.bandwidths = bandwidths(threads);
  return limits;
}

}  // namespace revisit::profiling
