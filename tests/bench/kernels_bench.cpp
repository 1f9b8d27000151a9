// Time of the blocked kernels beside the plain ones, over the lines of tests/problems/ with maps
// ten times as wide (a whole range image).
//   revisit_kernels_bench --benchmark_filter=lrn --benchmark_min_time=0.2
#include <benchmark/benchmark.h>

#include <chrono>
#include <limits>

#include "blocked.h"
#include "kernels/blocked/lrn.h"
#include "kernels/blocked/pooling.h"
#include "kernels/blocked/reorder.h"
#include "kernels/inner_product.h"
#include "problems.h"

namespace {

using namespace revisit;
using namespace revisit::engine;

constexpr int64_t kWider = 10;
constexpr int kThreads[] = {1, 2};

/// Registers `run(input, output, scratch)` with arrays of the sizes given. The counters are those
/// of the fastest iteration: on a machine that does other things, too, the mean says little.
template <class Run>
void measure(const std::string& name, int threads, int64_t in, int64_t out, int64_t scratch,
             double bytes, const Run& run) {
  using Clock = std::chrono::steady_clock;
  const auto body = [=](benchmark::State& state) {
    test::AlignedFloats input(in, 0x3D), output(out, 0), work(scratch, 0);
    double best = std::numeric_limits<double>::infinity();  // [s]
    for (auto _ : state) {
      const auto start = Clock::now();
      run(input.data(), output.data(), work.data());
      best = std::min(best, std::chrono::duration<double>(Clock::now() - start).count());
    }
    state.counters["min_us"] = best * 1e6;
    state.counters["GB/s"] = bytes / best * 1e-9;
  };
  benchmark::RegisterBenchmark((name + "/threads:" + std::to_string(threads)).c_str(), body)
      ->UseRealTime()
      ->Unit(benchmark::kMicrosecond);
}

double bytes_of(int64_t floats) {
  return static_cast<double>(floats) * sizeof(float);
}

void register_pooling(const test::Named<test::BlockedPooling>& named, int threads) {
  const int64_t n = named.problem.n, c = named.problem.c;
  PoolingProblem p = named.problem.window;
  p.w *= kWider;
  p.out_w *= kWider;
  p.threads = threads;
  const int64_t in = n * padded_channels(c) * p.h * p.w;
  const int64_t out = n * padded_channels(c) * p.out_h * p.out_w;
  measure("max_pool/" + named.name + "/plain", threads, in, out, 0, bytes_of(in + out),
          [=](const float* input, float* output, float*) { max_pool(p, input, output, nullptr); });
  measure(
      "max_pool/" + named.name + "/blocked", threads, in, out, 0, bytes_of(in + out),
      [=](const float* input, float* output, float*) { blocked_max_pool(p, c, input, output); });
  measure("average_pool/" + named.name + "/blocked", threads, in, out, 0, bytes_of(in + out),
          [=](const float* input, float* output, float*) {
            blocked_average_pool(p, c, input, output);
          });
  const LrnProblem lrn{n, c, p.h, p.w, 5, 1e-4F, 0.75F, 1, threads};
  measure("lrn_max_pool/" + named.name + "/blocked", threads, in, out,
          blocked_lrn_max_pool_scratch_floats(lrn, p), bytes_of(in + out),
          [=](const float* input, float* output, float* scratch) {
            blocked_lrn_max_pool(lrn, p, input, output, scratch);
          });
  const BlockedSize size{n, c, p.h * p.w, threads};
  measure(
      "reorder/" + named.name + "/to_blocked", threads, in, in, 0, bytes_of(2 * in),
      [=](const float* input, float* output, float*) { reorder_to_blocked(size, input, output); });
  measure(
      "reorder/" + named.name + "/to_plain", threads, in, in, 0, bytes_of(2 * in),
      [=](const float* input, float* output, float*) { reorder_to_plain(size, input, output); });
}

void register_lrn(const test::Named<LrnProblem>& named, int threads) {
  LrnProblem p = named.problem;
  p.w *= kWider;
  p.threads = threads;
  const int64_t floats = p.n * padded_channels(p.c) * p.h * p.w;
  measure(
      "lrn/" + named.name + "/plain", threads, floats, floats, 0, bytes_of(2 * floats),
      [=](const float* input, float* output, float*) { lrn_across_channels(p, input, output); });
  measure("lrn/" + named.name + "/blocked", threads, floats, floats, blocked_lrn_scratch_floats(p),
          bytes_of(2 * floats), [=](const float* input, float* output, float* scratch) {
            blocked_lrn(p, input, output, scratch);
          });
}

void register_inner_product(const test::Named<InnerProductProblem>& named, int threads) {
  InnerProductProblem p = named.problem;
  p.threads = threads;
  const int64_t weights = p.n * p.k;
  for (const InnerProductKernel* kernel : {&kInnerProductGemv, &kInnerProductGemm})
    if (!p.transposed || kernel == &kInnerProductGemm)
      measure("inner_product/" + named.name + "/" + kernel->name, threads, weights + p.m * p.k,
              p.m * p.n, 0, bytes_of(weights), [=](const float* input, float* output, float*) {
                kernel->run(p, input + weights, input, nullptr, output);
              });
}

}  // namespace

int main(int argc, char** argv) {
  for (const int threads : kThreads) {
    for (const auto& problem : test::pooling_problems()) register_pooling(problem, threads);
    for (const auto& problem : test::lrn_problems()) register_lrn(problem, threads);
    for (const auto& problem : test::inner_product_problems())
      register_inner_product(problem, threads);
  }
  benchmark::Initialize(&argc, argv);
  if (benchmark::ReportUnrecognizedArguments(argc, argv)) return 1;
  benchmark::RunSpecifiedBenchmarks();
}
