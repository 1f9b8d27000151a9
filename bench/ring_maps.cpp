// Search by rings in large maps, as rows of the table in docs/SPEED.md.
//   revisit_ring_maps MAP PLACES...
// MAP is an output of `revisit map build` for drives with poses. If PLACES exceeds its size, the
// others are randomly rotated copies, each with its own amount of noise. Queries are revisits:
// entries within 5 m of another of their drive, more than 50 frames away. Matches within 50 frames
// are excluded. Times are CPU time, the minimum of three rounds.
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <ctime>
#include <iostream>
#include <numbers>
#include <random>

#include "recall.h"
#include "revisit/base/error.h"
#include "revisit/maps/map_store.h"
#include "revisit/recognition/place_index.h"
#include "ring/describer.h"

namespace {

using namespace revisit;

constexpr int64_t kMaxQueries = 500, kNear = 50;

/// CPU time of this thread, because other programs do not affect it.
double seconds() {
  timespec now;
  clock_gettime(CLOCK_THREAD_CPUTIME_ID, &now);
  return double(now.tv_sec) + 1e-9 * double(now.tv_nsec);
}

struct RingMap {
  std::vector<MapEntry> entries;
  RingLayout layout;

  explicit RingMap(const std::string& file) {
    const auto map = open_map(file, MapAccess::kRead);
    map->read(
        0, [&](MapEntry&& entry) { entries.push_back(std::move(entry)); },
        [](const std::string& what) { throw revisit::InputError(what); });
    layout = RingDescriber(parse_ring_model(map->value(kProjectionValue).value(), file)).layout();
  }
  bool near_in_time(const MapEntry& a, const MapEntry& b) const {
    return a.drive == b.drive && std::abs(a.frame - b.frame) <= kNear;
  }
  bool same_place(const MapEntry& a, const MapEntry& b) const {
    return a.drive == b.drive && (a.pose->translation() - b.pose->translation()).norm() < 5 &&
           !near_in_time(a, b);
  }
};

struct RingQuery {
  int64_t place = 0;
  std::vector<CandidateRange> candidates;
};

/// Selects revisits among the first `n` entries, the same for any `most`.
std::vector<RingQuery> queries_of(const RingMap& map, int64_t n, int64_t most) {
  std::vector<int64_t> seen_again;
  for (int64_t i = 0; i < n; ++i)
    if (std::any_of(map.entries.begin(), map.entries.begin() + n, [&](const MapEntry& other) {
          return map.same_place(map.entries[size_t(i)], other);
        }))
      seen_again.push_back(i);
  std::shuffle(seen_again.begin(), seen_again.end(), std::mt19937(1));
  seen_again.resize(std::min(seen_again.size(), size_t(most)));
  std::vector<RingQuery> queries;
  for (const int64_t place : seen_again) {
    RingQuery& query = queries.emplace_back(RingQuery{place, {}});
    int64_t begin = 0;
    for (int64_t i = 0; i < n; ++i) {
      if (!map.near_in_time(map.entries[size_t(place)], map.entries[size_t(i)])) continue;
      if (i > begin) query.candidates.push_back({begin, i});
      begin = i + 1;
    }
    query.candidates.push_back({begin, std::numeric_limits<int64_t>::max()});
  }
  return queries;
}

/// Repeats a table, because generating 10^9 numbers takes long.
std::vector<float> gaussians(size_t count) {
  std::vector<float> numbers(count);
  std::mt19937 random(2);
  std::normal_distribution<float> gaussian;
  for (float& number : numbers) number = gaussian(random);
  return numbers;
}

void turn(std::span<float> x, const RingLayout& layout, double angle) {
  size_t at = 0;
  for (size_t f = 0; f < layout.size(); ++f) {
    const auto n = size_t(layout[f]);
    const auto c = float(std::cos(angle * double(f))), s = float(std::sin(angle * double(f)));
    for (size_t i = at; f > 0 && i < at + n; ++i) {
      const float real = x[i], imaginary = x[n + i];
      x[i] = c * real - s * imaginary;
      x[n + i] = s * real + c * imaginary;
    }
    at += f > 0 ? 2 * n : n;
  }
}

FloatMatrix descriptors_of(const RingMap& map, int64_t n) {
  const auto d = size_t(dim_of(map.layout));
  const auto real = std::min(n, int64_t(map.entries.size()));
  FloatMatrix all(n, int64_t(d));
  std::vector<double> squares(d);
  for (int64_t i = 0; i < real; ++i) {
    std::ranges::copy(map.entries[size_t(i)].descriptor, all.row(i).begin());
    for (size_t j = 0; j < d; ++j) squares[j] += all.row(i)[j] * all.row(i)[j];
  }
  const std::vector<float> noise = gaussians(1 << 22);
  std::mt19937_64 random(3);
  for (int64_t i = real; i < n; ++i) {
    const std::span<float> x = all.row(i);
    std::ranges::copy(all.row(i % real), x.begin());
    const float* const of_place = noise.data() + random() % (noise.size() - d);
    double square = 0;
    for (size_t j = 0; j < d; ++j) {
      x[j] += of_place[j] * float(std::sqrt(squares[j] / double(real)));
      square += double(x[j]) * double(x[j]);
    }
    for (float& value : x) value = float(value / std::sqrt(square));
    turn(x, map.layout, double(random() % 100000) * 2e-5 * std::numbers::pi);
  }
  return all;
}

struct Answers {
  std::vector<Match> matches;
  double build = 0;
  std::vector<double> times;
  double at(double share) const {
    std::vector<double> sorted = times;
    std::ranges::sort(sorted);
    return 1e3 * sorted[std::min(sorted.size() - 1, size_t(share * double(sorted.size())))];
  }
};

Answers ask(const FloatMatrix& all, const RingMap& map, const std::vector<RingQuery>& queries,
            int64_t candidates, int rounds) {
  Answers answers;
  const double start = seconds();
  PlaceIndex index(all.d, ring_comparison(map.layout, candidates));
  for (int64_t i = 0; i < all.n; ++i) index.add_view(all.row(i));
  answers.build = seconds() - start;
  answers.times.assign(queries.size(), 1e9);
  for (int round = 0; round < rounds; ++round)
    for (size_t q = 0; q < queries.size(); ++q) {
      const double begin = seconds();
      Match match = index.best(all.row(queries[q].place), queries[q].candidates);
      answers.times[q] = std::min(answers.times[q], seconds() - begin);
      if (round == 0) answers.matches.push_back(std::move(match));
    }
  return answers;
}

/// Fraction of the queries with a correct best place in `exact` that have one in `found`, too.
double kept(const RingMap& map, const std::vector<RingQuery>& queries, const Answers& exact,
            const Answers& found, int64_t& right) {
  const auto is_right = [&](size_t q, const Answers& answers) {
    const int64_t best = answers.matches[q].ranks.front();
    return best < int64_t(map.entries.size()) &&
           map.same_place(map.entries[size_t(queries[q].place)], map.entries[size_t(best)]);
  };
  int64_t both = 0;
  right = 0;
  for (size_t q = 0; q < queries.size(); ++q) {
    if (!is_right(q, exact)) continue;
    ++right;
    both += is_right(q, found);
  }
  return double(both) / double(right);
}

void measure(const RingMap& map, int64_t n) {
  const FloatMatrix all = descriptors_of(map, n);
  const auto real = std::min(n, int64_t(map.entries.size()));
  const std::vector<RingQuery> queries =
      queries_of(map, real, std::clamp<int64_t>(100'000'000 / n, 50, kMaxQueries));
  const Answers exact = ask(all, map, queries, 0, 1);
  for (const int64_t candidates : {100, 300, 1000}) {
    const Answers with_codes = ask(all, map, queries, candidates, 3);
    int64_t right = 0;
    const double share = kept(map, queries, exact, with_codes, right);
    std::printf("| %ld | %ld | %.2f | %.3g, %.3g | %.3g | %ld | %.4f | %.4f |\n", n, candidates,
                with_codes.build, with_codes.at(0.5), with_codes.at(0.99), exact.at(0.5), right,
                share, recall_of(exact.matches, with_codes.matches));
    std::fflush(stdout);
  }
}

}  // namespace

int main(int count, char** arguments) try {
  if (count < 3) {
    std::cerr << "usage: revisit_ring_maps MAP PLACES...\n";
    return 2;
  }
  const RingMap map(arguments[1]);
  std::cout << "| entries | candidates | keys made in [s] | with keys [ms] | every heading, median "
               "[ms] | found by every heading | of them with keys | of the best four |\n"
               "|---|---|---|---|---|---|---|---|\n";
  for (int i = 2; i < count; ++i) measure(map, std::atoll(arguments[i]));
} catch (const std::exception& error) {
  std::cerr << error.what() << '\n';
  return 1;
}
