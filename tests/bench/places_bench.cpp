// Time of one query against many places, as a recogniser asks it.
//   revisit_places_bench --benchmark_min_time=2
#include <benchmark/benchmark.h>

#include <numeric>
#include <random>

#include "revisit/recognition/keys.h"
#include "revisit/recognition/ring/match.h"

namespace {

using namespace revisit::pipeline;

/// Descriptors of unit length, as a shipped ring model gives them.
struct Places {
  RingLayout layout{{39, 39, 38, 34, 34, 35, 33, 31, 29, 29, 30, 27, 28, 27, 27, 26, 25}};
  FloatMatrix descriptors;
  std::vector<int64_t> candidates;

  explicit Places(int64_t n) : descriptors(n, layout.numbers()), candidates(n) {
    std::mt19937 random(1);
    std::normal_distribution<float> gaussian(0, 1 / std::sqrt(float(layout.numbers())));
    for (float& value : descriptors.values) value = gaussian(random);
    std::iota(candidates.begin(), candidates.end(), 0);
  }
};

void measure(benchmark::State& state, const Places& places, const Similarity& similarity) {
  std::vector<double> similarities(places.candidates.size());
  int64_t query = 0;
  for (auto _ : state)
    similarity(places.descriptors.row(query++ % places.descriptors.n), places.descriptors,
               places.candidates, similarities);
}

void rings_at_all_headings(benchmark::State& state) {
  const Places places(state.range(0));
  measure(state, places, ring_similarity(places.layout));
}

void rings_by_keys(benchmark::State& state) {
  const Places places(state.range(0));
  const KeyOf key_of = ring_key(places.layout);
  measure(state, places,
          similarity_by_keys(ring_similarity(places.layout), key_of,
                             keys_of(places.descriptors, key_of), state.range(1)));
}

BENCHMARK(rings_at_all_headings)->Arg(10000)->Unit(benchmark::kMillisecond);
BENCHMARK(rings_by_keys)->Args({10000, 100})->Args({10000, 300})->Unit(benchmark::kMillisecond);

}  // namespace

BENCHMARK_MAIN();
