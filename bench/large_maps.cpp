// Search in large maps of synthetic places, as rows of the tables in docs/SPEED.md.
//   revisit_large_maps PLACES cosines[NUMBERS] WAY...
// Ways: sgemv (OpenBLAS, products alone), exact, threads (exact, on two), many (64 queries at
// once), graph (HNSW). Query times are the minimum of several rounds; all ways run in turn.
#include <cblas.h>

#include <algorithm>
#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <fstream>
#include <iostream>
#include <map>
#include <random>
#include <string>

#include "recall.h"
#include "revisit/base/error.h"
#include "revisit/maps/map.h"

namespace {

using namespace revisit;

constexpr int64_t kQueries = 32, kRounds = 3, kCandidates = 300;

double seconds() {
  return std::chrono::duration<double>(std::chrono::steady_clock::now().time_since_epoch()).count();
}

double resident_bytes() {
  double pages = 0;
  std::ifstream("/proc/self/statm") >> pages >> pages;
  return pages * 4096;
}

/// Draws Gaussian numbers from a table, because generating 4 * 10^9 takes minutes.
class Gaussian {
 public:
  explicit Gaussian(uint64_t seed) : random_(seed), table_(1 << 16) {
    std::mt19937 of_table(1);
    std::normal_distribution<float> gaussian;
    for (float& value : table_) value = gaussian(of_table);
  }
  float operator()() {
    if (left_ == 0) {
      bits_ = random_();
      left_ = 4;
    }
    --left_;
    const float value = table_[bits_ & 0xffff];
    bits_ >>= 16;
    return value;
  }

 private:
  std::mt19937_64 random_;
  uint64_t bits_ = 0;
  int left_ = 0;
  std::vector<float> table_;
};

/// Standard deviation of number i is i^-0.75, like variances of a PCA. A query is a place with half
/// as much noise.
struct World {
  std::vector<float> spread;
  Gaussian random{7};

  explicit World(int numbers) {
    for (int i = 1; i <= numbers; ++i) spread.push_back(std::pow(static_cast<float>(i), -0.75F));
  }
  int64_t dim() const { return int64_t(spread.size()); }
  void place(std::span<float> x) {
    for (size_t i = 0; i < x.size(); ++i) x[i] = spread[i] * random();
    normalize(x);
  }
  void query(std::span<const float> place, std::span<float> x) {
    std::vector<float> noise(x.size());
    this->place(noise);
    for (size_t i = 0; i < x.size(); ++i) x[i] = place[i] + 0.5F * noise[i];
    normalize(x);
  }
  static void normalize(std::span<float> x) {
    double sum = 0;
    for (const float v : x) sum += v * v;
    for (float& v : x) v = static_cast<float>(v / std::sqrt(sum));
  }
};

struct Way {
  std::string name;
  std::function<void(int64_t query, Match& match)> ask;
  int64_t together = 1;  // queries per call
  double build = 0, bytes = 0;
  std::vector<Match> matches = std::vector<Match>(kQueries);
  std::vector<double> times = std::vector<double>(kQueries, 1e9);
};

std::vector<Match> best_of(std::vector<Match> matches) {
  for (Match& match : matches) match.ranks.resize(1);
  return matches;
}

void print(const std::string& places, const std::string& feature, Way& way,
           const std::vector<Match>* exact) {
  double sum = 0;
  std::vector<double> times;
  for (int64_t q = 0; q < kQueries; q += way.together) times.push_back(way.times[size_t(q)]);
  for (const double t : times) sum += t;
  std::ranges::sort(times);
  const auto at = [&](double share) {
    return 1e3 * times[std::min(times.size() - 1, size_t(share * double(times.size())))];
  };
  std::printf("| %s | %s | %s | %.1f | %.0f | %.4g | %.3g | %.3g | ", places.c_str(),
              feature.c_str(), way.name.c_str(), way.build, way.bytes, kQueries / sum, at(0.5),
              at(0.99));
  if (exact)
    std::printf("%.3f | %.3f |\n", recall_of(best_of(*exact), best_of(way.matches)),
                recall_of(*exact, way.matches));
  else
    std::printf("| |\n");
  std::fflush(stdout);
}

void measure(int64_t n, const std::string& feature, const std::vector<std::string>& names) {
  World world(feature == "cosines" ? 400 : std::atoi(feature.c_str() + 7));
  const auto wants = [&](const char* name) {
    return std::ranges::find(names, name) != names.end();
  };
  const double before = resident_bytes();
  PlaceIndex index(world.dim());
  double build = 0;
  std::vector<float> x(size_t(world.dim()));
  for (int64_t i = 0; i < n; ++i) {
    world.place(x);
    const double start = seconds();
    index.add(x);
    build += seconds() - start;
  }
  const double bytes = (resident_bytes() - before) / double(n);
  FloatMatrix queries(kQueries, world.dim());
  for (int64_t q = 0; q < kQueries; ++q)
    world.query(index.descriptor((q * 7919 + 13) % n), queries.row(q));

  const CandidateRange all{0, n};
  std::vector<Way> ways;
  const auto exact_way = [&](const char* name, const PlaceIndex& in, int threads) {
    ways.push_back({name, [&in, &queries, all, threads](int64_t q, Match& match) {
                      match = in.best(queries.row(q), {&all, 1}, {.threads = threads});
                    }});
    ways.back().build = build;
    ways.back().bytes = bytes;
  };
  FloatMatrix keys;
  std::vector<float> products(size_t(n), 0);
  if (wants("sgemv")) {
    keys = FloatMatrix(n, world.dim());
    for (int64_t i = 0; i < n; ++i) std::ranges::copy(index.descriptor(i), keys.row(i).begin());
    ways.push_back({"sgemv", [&](int64_t q, Match&) {
                      cblas_sgemv(CblasRowMajor, CblasNoTrans, int(n), int(keys.d), 1,
                                  keys.values.data(), int(keys.d), queries.row(q).data(), 1, 0,
                                  products.data(), 1);
                    }});
  }
  if (wants("exact")) exact_way("exact", index, 1);
  if (wants("threads")) exact_way("exact, 2 threads", index, 2);
  if (wants("many")) {
    ways.push_back({"exact, 32 at once", [&](int64_t, Match& match) {
                      std::vector<Query> together;
                      for (int64_t q = 0; q < kQueries; ++q)
                        together.push_back({queries.row(q), {&all, 1}});
                      auto matches = index.best_of_many(together);
                      std::ranges::move(matches, &match);
                    }});
    ways.back().together = kQueries;
  }
  // A graph changes the index: it is measured after the exact search.
  for (int64_t round = 0; round < kRounds; ++round)
    for (int64_t q = 0; q < kQueries; ++q)
      for (Way& way : ways) {
        if (q % way.together != 0) continue;
        const double start = seconds();
        way.ask(q, way.matches[size_t(q)]);
        way.times[size_t(q)] = std::min(way.times[size_t(q)], seconds() - start);
      }
  const std::vector<Match>* exact = nullptr;
  for (const Way& way : ways)
    if (way.name == "exact") exact = &way.matches;
  const std::string places = std::to_string(n);
  for (Way& way : ways) print(places, feature, way, way.name == "sgemv" ? nullptr : exact);
  keys = {};

  if (!wants("graph")) return;
  const double memory = resident_bytes(), start = seconds();
  std::unique_ptr<CandidateSource> graph = make_hnsw_source(index, 2);
  Way way{"graph", [&](int64_t q, Match& match) { match = index.best(queries.row(q), {&all, 1}); }};
  way.build = seconds() - start;
  way.bytes = (resident_bytes() - memory) / double(n);
  index.set_candidate_source(std::move(graph), kCandidates);
  for (int64_t round = 0; round < 3 * kRounds; ++round)
    for (int64_t q = 0; q < kQueries; ++q) {
      const double begin = seconds();
      way.ask(q, way.matches[size_t(q)]);
      way.times[size_t(q)] = std::min(way.times[size_t(q)], seconds() - begin);
    }
  print(places, feature, way, exact);
}

}  // namespace

int main(int count, char** arguments) try {
  if (count < 4 || !std::string(arguments[2]).starts_with("cosines")) {
    std::cerr << "usage: revisit_large_maps PLACES cosines[NUMBERS] WAY...\n";
    return 2;
  }
  openblas_set_num_threads(1);
  std::cout << "| places | compared | search | build [s] | bytes a place | queries/s | p50 [ms] | "
               "p99 [ms] | recall of the best | of the best four "
               "|\n|---|---|---|---|---|---|---|---|---|---|\n";
  measure(std::atoll(arguments[1]), arguments[2], {arguments + 3, arguments + count});
} catch (const std::exception& error) {
  std::cerr << error.what() << '\n';
  return 1;
}
