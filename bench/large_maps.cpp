// Search in large maps, as rows of the tables in docs/reference/SPEED.md.
//   revisit_large_maps cosines PLACES DIMENSIONS [graph]
// Synthetic places. Wall time, the minimum of three rounds.
//   revisit_large_maps rings MAP PLACES...
// MAP is an output of `revisit map build` for drives with poses. If PLACES exceeds its size, the
// others are randomly rotated copies, each with its own amount of noise. Queries are revisits:
// entries within 5 m of another of their drive, more than 50 frames away. Matches within 50 frames
// are excluded. CPU time, the minimum of three rounds.
//   revisit_large_maps server MAP PLACES ADDRESS...
// Maps on a server, shards with PLACES each. They are kept; later runs add only what is missing.
#include <cblas.h>

#include <cstdio>
#include <ctime>
#include <iostream>

#include "recall.h"
#include "revisit/recognition/place_index.h"
#include "ring_places.h"

namespace {

using namespace revisit;

constexpr int64_t kCosineQueries = 32, kMaxQueries = 500, kNear = 50;

/// Of this thread, because other programs do not affect it.
double cpu_seconds() {
  timespec now;
  clock_gettime(CLOCK_THREAD_CPUTIME_ID, &now);
  return double(now.tv_sec) + 1e-9 * double(now.tv_nsec);
}

struct Answers {
  std::vector<Match> matches;
  std::vector<double> ms;
};

Answers ask(const PlaceIndex& index, const std::vector<Query>& queries, int rounds,
            double (*seconds)(), int threads = 1) {
  Answers answers{std::vector<Match>(queries.size()), std::vector<double>(queries.size(), 1e9)};
  for (int round = 0; round < rounds; ++round)
    for (size_t q = 0; q < queries.size(); ++q) {
      const double start = seconds();
      answers.matches[q] =
          index.best(queries[q].descriptor, queries[q].candidates, {.threads = threads});
      answers.ms[q] = std::min(answers.ms[q], 1e3 * (seconds() - start));
    }
  return answers;
}

/// Standard deviation of number i is i^-0.75, like variances of a PCA. A query is a place with half
/// as much noise.
void measure_cosines(int64_t n, int64_t dim, bool graph) {
  openblas_set_num_threads(1);
  Noise noise;
  auto place = [&, last = std::vector<float>(size_t(dim))]() mutable {
    const float *const a = noise.draw(last.size()), *const b = noise.draw(last.size());
    for (size_t i = 0; i < last.size(); ++i)
      last[i] = (a[i] + b[i]) * std::pow(float(i + 1), -0.75F);
    normalize(last);
    return last;
  };
  double memory = heap_bytes();
  PlaceIndex index(dim);
  for (int64_t i = 0; i < n; ++i) index.add(place());
  const CandidateRange all{0, n};
  std::vector<std::vector<float>> descriptors;
  for (int64_t q = 0; q < kCosineQueries; ++q) {
    std::vector<float>& x = descriptors.emplace_back(index.descriptor((q * 7919 + 13) % n));
    const std::vector<float> other = place();
    for (size_t i = 0; i < x.size(); ++i) x[i] += 0.5F * other[i];
    normalize(x);
  }
  std::vector<Query> queries;
  for (const std::vector<float>& x : descriptors) queries.push_back({x, {&all, 1}});
  const Answers exact = ask(index, queries, 3, wall_seconds);
  const auto print = [&](const char* search, const Answers& answers) {
    std::printf("| %ld | %ld | %s | %.0f | %.3g | %.3g | %.3f |\n", n, dim, search,
                (heap_bytes() - memory) / double(n), quantile(answers.ms, 0.5),
                quantile(answers.ms, 0.99), recall_of(exact.matches, answers.matches));
  };
  std::puts(
      "| places | dimensions | search | bytes a place | p50 [ms] | p99 [ms] | recall of the best "
      "four |\n|---|---|---|---|---|---|---|");
  print("exact", exact);
  print("exact, 2 threads", ask(index, queries, 3, wall_seconds, 2));
  const double start = wall_seconds();
  const std::vector<Match> matches = index.best_of_many(queries);
  print("exact, 32 at once", {matches, {1e3 * (wall_seconds() - start) / kCosineQueries}});
  if (!graph) return;
  memory = heap_bytes();
  index.set_candidate_source(make_hnsw_source(index, 2), 300);
  print("graph", ask(index, queries, 3, wall_seconds));
}

bool near_in_time(const MapEntry& a, const MapEntry& b) {
  return a.drive == b.drive && std::abs(a.frame - b.frame) <= kNear;
}

bool same_place(const MapEntry& a, const MapEntry& b) {
  return a.drive == b.drive && (a.pose->translation() - b.pose->translation()).norm() < 5 &&
         !near_in_time(a, b);
}

void measure_rings(const RingMap& map, int64_t n) {
  Places places(map);
  FloatMatrix all(n, places.dim());
  for (int64_t i = 0; i < n; ++i) std::ranges::copy(places.next(), all.row(i).begin());
  const auto real = map.entries.begin(), end = real + std::min(n, std::ssize(map.entries));
  std::vector<int64_t> revisits;
  for (auto i = real; i != end; ++i)
    if (std::any_of(real, end, [&](const MapEntry& other) { return same_place(*i, other); }))
      revisits.push_back(i - real);
  std::shuffle(revisits.begin(), revisits.end(), std::mt19937(1));
  const int64_t most = std::clamp<int64_t>(100'000'000 / n, 50, kMaxQueries);
  revisits.resize(std::min(revisits.size(), size_t(most)));
  std::vector<std::vector<CandidateRange>> candidates_of;
  std::vector<Query> queries;
  for (const int64_t revisit : revisits) {
    std::vector<CandidateRange>& ranges = candidates_of.emplace_back();
    int64_t begin = 0;
    for (auto i = real; i != end; ++i) {
      if (!near_in_time(real[revisit], *i)) continue;
      if (i - real > begin) ranges.push_back({begin, i - real});
      begin = i - real + 1;
    }
    ranges.push_back({begin, n});
    queries.push_back({all.row(revisit), {}});
  }
  for (size_t q = 0; q < queries.size(); ++q) queries[q].candidates = candidates_of[q];
  const auto is_correct = [&](size_t q, const Answers& answers) {
    const int64_t best = answers.matches[q].ranks.front();
    return best < end - real && same_place(real[revisits[q]], real[best]);
  };
  Answers exact;
  for (const int64_t candidates : {0, 100, 300, 1000}) {
    const double start = cpu_seconds();
    PlaceIndex index(all.d, ring_comparison(map.layout, candidates));
    for (int64_t i = 0; i < n; ++i) index.add_view(all.row(i));
    const double build = cpu_seconds() - start;
    const Answers answers = ask(index, queries, candidates == 0 ? 1 : 3, cpu_seconds);
    if (candidates == 0) exact = answers;
    int64_t correct = 0, kept = 0;
    for (size_t q = 0; q < queries.size(); ++q) {
      correct += is_correct(q, exact);
      kept += is_correct(q, exact) && is_correct(q, answers);
    }
    std::printf("| %ld | %ld | %.2f | %.3g, %.3g | %ld | %.4f | %.4f |\n", n, candidates, build,
                quantile(answers.ms, 0.5), quantile(answers.ms, 0.99), correct,
                double(kept) / double(correct), recall_of(exact.matches, answers.matches));
    std::fflush(stdout);
  }
}

}  // namespace

int main(int count, char** arguments) try {
  const std::string what = count < 4 ? "" : arguments[1];
  if (what == "cosines") {
    measure_cosines(std::atoll(arguments[2]), std::atoll(arguments[3]), count > 4);
  } else if (what == "rings") {
    std::puts(
        "| entries | candidates, or 0: all | codes built [s] | p50, p99 [ms] | found among all | "
        "of them found | of the best four |\n|---|---|---|---|---|---|---|");
    const RingMap map(arguments[2]);
    for (int i = 3; i < count; ++i) measure_rings(map, std::atoll(arguments[i]));
  } else if (what == "server" && count > 4) {
    measure_server(RingMap(arguments[2]), std::atoll(arguments[3]),
                   {arguments + 4, arguments + count});
  } else {
    std::cerr << "usage: revisit_large_maps cosines PLACES DIMENSIONS [graph]\n"
                 "       revisit_large_maps rings MAP PLACES...\n"
                 "       revisit_large_maps server MAP PLACES ADDRESS...\n";
    return 2;
  }
} catch (const std::exception& error) {
  std::cerr << error.what() << '\n';
  return 1;
}
