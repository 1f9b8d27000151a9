// Time of one query against many places, as in a recognizer, and of a full drive.
//   revisit_places_bench --benchmark_min_time=2
#include <benchmark/benchmark.h>

#include <random>

#include "revisit/evaluation/descriptors.h"
#include "revisit/recognition/ring/descriptor.h"

namespace {

using namespace revisit;

/// Rows have a length of about 1.
FloatMatrix random_rows(int64_t n, int64_t d) {
  FloatMatrix rows(n, d);
  std::mt19937 random(1);
  std::normal_distribution<float> gaussian(0, 1 / std::sqrt(static_cast<float>(d)));
  for (float& value : rows.values) value = gaussian(random);
  return rows;
}

/// Arguments: places, number of candidates by compact codes.
void rings(benchmark::State& state) {
  const RingLayout layout{{39, 39, 38, 34, 34, 35, 33, 31, 29, 29, 30, 27, 28, 27, 27, 26, 25}};
  const FloatMatrix descriptors = random_rows(state.range(0), layout.dim());
  Comparison comparison = ring_comparison(layout, state.range(1));
  comparison.relative_yaw = nullptr;
  PlaceIndex index(descriptors.d, comparison);
  for (int64_t i = 0; i < descriptors.n; ++i) index.add_view(descriptors.row(i));
  const CandidateRange all{0, descriptors.n};
  int64_t query = 0;
  for (auto _ : state) index.best(descriptors.row(query++ % descriptors.n), {&all, 1});
}

/// Compares every scan with those more than 50 before it, by cosine. Arguments: scans, dimensions.
void whole_drive(benchmark::State& state) {
  const Descriptors descriptors{random_rows(state.range(0), state.range(1))};
  Trajectory trajectory;
  for (int frame = 0; frame < state.range(0); ++frame) trajectory.frames.push_back(frame);
  const Task task = make_tasks("online", "", trajectory).at(0);
  for (auto _ : state) retrieve(descriptors, task);
}

BENCHMARK(rings)
    ->Args({10000, 0})
    ->Args({10000, 100})
    ->Args({10000, 300})
    ->Unit(benchmark::kMillisecond);
BENCHMARK(whole_drive)->Args({4541, 400})->Args({300, 448000})->Unit(benchmark::kMillisecond);

}  // namespace

BENCHMARK_MAIN();
