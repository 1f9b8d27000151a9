// Search by rings in large maps, as rows of the table in docs/SPEED.md.
//   revisit_ring_maps MAP PLACES...
// MAP is an output of `revisit map build` for drives with poses. If PLACES exceeds its size, the
// others are randomly rotated copies, each with its own amount of noise. Queries are revisits:
// entries within 5 m of another of their drive, more than 50 frames away. Matches within 50 frames
// are excluded. Times are CPU time, the minimum of three rounds.
//   revisit_ring_maps MAP server PLACES SHARDS
// Fills a PostgreSQL server of its own with so many entries, opens them in two processes, and
// prints the rows of docs/SERVER.md.
#include <malloc.h>
#include <sys/socket.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <ctime>
#include <fstream>
#include <future>
#include <iostream>
#include <numbers>
#include <random>

#include "postgres_server.h"
#include "recall.h"
#include "revisit/base/error.h"
#include "revisit/maps/place_recognizer.h"
#include "revisit/recognition/ring/descriptor.h"
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
  std::string content;  // of the projection
  RingLayout layout;

  explicit RingMap(const std::string& file) {
    const auto map = open_map(file, MapAccess::kRead);
    map->read(
        0, [&](MapEntry&& entry) { entries.push_back(std::move(entry)); },
        [](const std::string& what) { throw revisit::InputError(what); });
    content = map->value(kProjectionValue).value();
    layout = RingDescriber(parse_ring_model(content, file)).layout();
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

/// Entries of the map, then randomly rotated copies of them, each with its own amount of noise.
class Places {
 public:
  explicit Places(const RingMap& map) : map_(map), spread_(size_t(dim_of(map.layout))) {
    std::mt19937 random(2);
    std::normal_distribution<float> gaussian;
    for (float& number : noise_) number = gaussian(random);
    for (const MapEntry& entry : map.entries)
      for (size_t j = 0; j < spread_.size(); ++j)
        spread_[j] += entry.descriptor[j] * entry.descriptor[j] / float(map.entries.size());
    for (float& square : spread_) square = std::sqrt(square);
  }
  int64_t dim() const { return int64_t(spread_.size()); }
  std::vector<float> next() {
    const int64_t i = made_++, real = int64_t(map_.entries.size());
    const std::vector<float>& base = map_.entries[size_t(i % real)].descriptor;
    return i < real ? base : altered(base, 1);
  }
  std::vector<float> altered(std::vector<float> x, float amount) {
    // From a table, because generating 10^9 numbers takes long.
    const float* const noise = noise_.data() + random_() % (noise_.size() - x.size());
    double square = 0;
    for (size_t j = 0; j < x.size(); ++j) {
      x[j] += amount * noise[j] * spread_[j];
      square += double(x[j]) * double(x[j]);
    }
    for (float& value : x) value = float(value / std::sqrt(square));
    turn(x, map_.layout, double(random_() % 100000) * 2e-5 * std::numbers::pi);
    return x;
  }

 private:
  const RingMap& map_;
  std::vector<float> spread_, noise_ = std::vector<float>(1 << 22);
  std::mt19937_64 random_{3};
  int64_t made_ = 0;
};

FloatMatrix descriptors_of(const RingMap& map, int64_t n) {
  Places places(map);
  FloatMatrix all(n, places.dim());
  for (int64_t i = 0; i < n; ++i) std::ranges::copy(places.next(), all.row(i).begin());
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

// Maps on a server.

constexpr int64_t kServerCandidates = 1000, kServerQueries = 200, kAdded = 20;

using Clock = std::chrono::steady_clock;

double wall_seconds() {
  return std::chrono::duration<double>(Clock::now().time_since_epoch()).count();
}

double at(std::vector<double> values, double share) {
  std::ranges::sort(values);
  return values[std::min(values.size() - 1, size_t(share * double(values.size())))];
}

/// Memory of this process, without pages that a file can give back [bytes].
double anonymous_bytes() {
  std::ifstream status("/proc/self/status");
  for (std::string name, kilobytes; status >> name; std::getline(status, kilobytes))
    if (name == "RssAnon:") {
      status >> kilobytes;
      return 1000 * 1.024 * std::stod(kilobytes);
    }
  return 0;
}

/// Its features are descriptors.
FeatureExtractor descriptors_as_features(const RingMap& map) {
  const RingOptions options{.candidates = kServerCandidates};
  const Projection projection = ring_projection(parse_ring_model(map.content, "map"), options);
  FeatureExtractor extractor;
  extractor.name = extractor.key = "ring descriptors";
  extractor.dim = projection.dim;
  extractor.comparison = projection.comparison;
  extractor.make = []() -> FeatureFunction<PointCloud> { return {}; };
  return extractor;
}

/// A map of some shards in one process.
class Shards {
 public:
  Shards(const FeatureExtractor& extractor, const std::vector<std::string>& urls) {
    const double before = anonymous_bytes(), start = wall_seconds();
    for (const std::string& url : urls) {
      const MapFingerprint fingerprint = PlaceRecognizer::fingerprint_of(extractor, {});
      shards_.push_back(std::make_unique<PlaceRecognizer>(
          extractor, RecognizerOptions{}, open_map(url, MapAccess::kWrite, &fingerprint)));
      size += shards_.back()->size();
    }
    open = wall_seconds() - start;
    bytes = anonymous_bytes() - before;
  }
  /// The best score of all shards wins. Returns shard and index.
  std::pair<size_t, int64_t> query(const Description& scan) const {
    std::vector<std::future<std::optional<Loop>>> answers;
    for (const auto& shard : shards_)
      answers.push_back(std::async(shards_.size() == 1 ? std::launch::deferred : std::launch::async,
                                   [&] { return shard->query(scan); }));
    std::pair<size_t, int64_t> best;
    double score = -1e9;
    for (size_t i = 0; i < answers.size(); ++i)
      if (const auto loop = answers[i].get(); loop && loop->score > score) {
        score = loop->score;
        best = {i, loop->index};
      }
    return best;
  }
  PlaceRecognizer& last() { return *shards_.back(); }

  double open = 0, bytes = 0;
  int64_t size = 0;

 private:
  std::vector<std::unique_ptr<PlaceRecognizer>> shards_;
};

void fill(const RingMap& map, const FeatureExtractor& extractor, int64_t n,
          const std::vector<std::string>& urls) {
  constexpr int64_t kBatch = 1000;
  Places places(map);
  const MapFingerprint fingerprint = PlaceRecognizer::fingerprint_of(extractor, {});
  for (size_t shard = 0; shard < urls.size(); ++shard) {
    const auto store =
        open_map(urls[shard], MapAccess::kNew, &fingerprint, DescriptorType::kFloat16);
    const int64_t count = n / int64_t(urls.size());
    for (int64_t first = 0; first < count; first += kBatch) {
      std::vector<MapEntry> batch(size_t(std::min(kBatch, count - first)));
      for (size_t i = 0; i < batch.size(); ++i)
        batch[i] = {.drive = str("drive ", shard),
                    .frame = first + int64_t(i),
                    .descriptor = places.next()};
      store->add(batch);
    }
  }
}

/// Queries are noisy, rotated copies of entries of `map`, which are the first of shard 0.
void measure_queries(const char* process, const RingMap& map, const Shards& shards) {
  Places places(map);
  std::vector<double> times;
  int64_t found = 0;
  for (int64_t q = 0; q < kServerQueries; ++q) {
    const int64_t entry = q * 7919 % int64_t(map.entries.size());
    const Description scan{.feature = places.altered(map.entries[size_t(entry)].descriptor, 0.3F),
                           .error = ""};
    const double start = wall_seconds();
    found += shards.query(scan) == std::pair(size_t{0}, entry);
    times.push_back(1e3 * (wall_seconds() - start));
  }
  std::printf(
      "%s: %ld entries open in %.1f s, %.0f bytes an entry, query p50 %.1f ms, p99 %.1f ms, "
      "%ld of %ld found\n",
      process, shards.size, shards.open, shards.bytes / double(shards.size), at(times, 0.5),
      at(times, 0.99), found, kServerQueries);
  std::fflush(stdout);
}

/// In each of two processes. The first adds an entry when the other is ready, and writes when.
void measure_process(bool is_first, int socket, const RingMap& map,
                     const std::vector<std::string>& urls) {
  const FeatureExtractor extractor = descriptors_as_features(map);
  Shards shards(extractor, urls);
  measure_queries(is_first ? "process 1" : "process 2", map, shards);
  Places places(map);
  std::vector<double> delays;
  for (int64_t i = 0; i < kAdded; ++i) {
    double start = 0;
    const auto transfer = [&](auto function) {
      if (function(socket, &start, sizeof(start)) != sizeof(start)) throw Error("a process ended");
    };
    if (is_first) {
      transfer(::read);
      std::this_thread::sleep_for(std::chrono::milliseconds(50));
      start = wall_seconds();
      shards.last().add({.feature = places.next(), .error = ""}, {.drive = "new", .frame = i});
      delays.push_back(1e3 * (wall_seconds() - start));
      transfer(::write);
    } else {
      const int64_t known = shards.last().size();
      transfer(::write);
      for (; shards.last().size() == known; shards.last().refresh_if_updated())
        std::this_thread::sleep_for(std::chrono::microseconds(200));
      const double seen = wall_seconds();
      transfer(::read);
      delays.push_back(1e3 * (seen - start));
    }
  }
  std::printf("%s: p50 %.1f ms, p99 %.1f ms\n",
              is_first ? "add() returns" : "the other process sees the entry", at(delays, 0.5),
              at(delays, 0.99));
}

void measure_server(const RingMap& map, int64_t n, int64_t shards) {
  const test::PostgresServer server;
  std::vector<std::string> urls;
  for (int64_t i = 0; i < shards; ++i) urls.push_back(server.url(str("shard_", i)));
  const double start = wall_seconds();
  fill(map, descriptors_as_features(map), n, urls);
  const double filled = wall_seconds() - start;
  std::printf(
      "%ld entries in %ld shards: filled in %.0f s, %.0f entries/s, %.2f GB on the server\n", n,
      shards, filled, double(n) / filled,
      std::stod(server.execute("SELECT pg_database_size('postgres')")) / 1e9);
  std::fflush(stdout);
  int ends[2];
  if (::socketpair(AF_UNIX, SOCK_STREAM, 0, ends) != 0) throw Error("no sockets");
  for (const bool is_first : {true, false})
    if (::fork() == 0) {
      ::malloc_trim(0);  // memory of fill(), which would be used again
      measure_process(is_first, ends[is_first ? 1 : 0], map, urls);
      std::fflush(stdout);
      std::_Exit(0);
    }
  for (int i = 0; i < 2; ++i) ::wait(nullptr);
}

}  // namespace

int main(int count, char** arguments) try {
  if (count < 3) {
    std::cerr << "usage: revisit_ring_maps MAP PLACES... | MAP server PLACES SHARDS\n";
    return 2;
  }
  const RingMap map(arguments[1]);
  if (count == 5 && std::string(arguments[2]) == "server") {
    measure_server(map, std::atoll(arguments[3]), std::atoll(arguments[4]));
    return 0;
  }
  std::cout << "| entries | candidates | keys made in [s] | with keys [ms] | every heading, median "
               "[ms] | found by every heading | of them with keys | of the best four |\n"
               "|---|---|---|---|---|---|---|---|\n";
  for (int i = 2; i < count; ++i) measure(map, std::atoll(arguments[i]));
} catch (const std::exception& error) {
  std::cerr << error.what() << '\n';
  return 1;
}
