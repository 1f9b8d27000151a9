#include <sys/socket.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cstdio>
#include <future>
#include <thread>

#include "revisit/base/text.h"
#include "revisit/maps/map.h"
#include "revisit/recognition/ring/descriptor.h"
#include "ring_places.h"

namespace revisit {
namespace {

constexpr int64_t kCandidates = 1000, kQueries = 200, kAdded = 20;

/// Its features are descriptors.
FeatureExtractor descriptors_as_features(const RingMap& map) {
  const RingOptions options{.candidates = kCandidates};
  const Projection projection = ring_projection(parse_ring_model(map.projection, "map"), options);
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
    const double before = heap_bytes(), start = wall_seconds();
    for (const std::string& url : urls) {
      const MapFingerprint fingerprint = fingerprint_of(extractor, {});
      shards_.push_back(std::make_unique<Map>(extractor, MapOptions{},
                                              open_map(url, MapAccess::kWrite, &fingerprint)));
      size += shards_.back()->size();
    }
    open = wall_seconds() - start;
    bytes = heap_bytes() - before;
  }
  /// The best score of all shards wins. Returns shard and index.
  std::pair<size_t, int64_t> query(const Description& scan) const {
    std::vector<std::future<std::optional<Loop>>> answers;
    for (const auto& shard : shards_)
      answers.push_back(std::async(std::launch::async, [&] { return shard->query(scan); }));
    std::pair<size_t, int64_t> best;
    double score = -1e9;
    for (size_t i = 0; i < answers.size(); ++i)
      if (const auto loop = answers[i].get(); loop && loop->score > score) {
        score = loop->score;
        best = {i, loop->index};
      }
    return best;
  }
  Map& last() { return *shards_.back(); }

  double open = 0, bytes = 0;
  int64_t size = 0;

 private:
  std::vector<std::unique_ptr<Map>> shards_;
};

/// Resumes: an earlier run has added batches, and entries after the last one.
void fill(const RingMap& map, const FeatureExtractor& extractor, int64_t count,
          const std::vector<std::string>& urls) {
  constexpr int64_t kBatch = 1000;
  Places places(map);
  const MapFingerprint fingerprint = fingerprint_of(extractor, {});
  for (size_t shard = 0; shard < urls.size(); ++shard) {
    const auto store =
        open_map(urls[shard], MapAccess::kWrite, &fingerprint, DescriptorType::kFloat16);
    const int64_t had = store->size();
    const double start = wall_seconds();
    for (int64_t first = 0; first < count; first += kBatch) {
      std::vector<MapEntry> batch(size_t(std::min(kBatch, count - first)));
      for (size_t i = 0; i < batch.size(); ++i)
        batch[i] = {.drive = str("drive ", shard),
                    .frame = first + int64_t(i),
                    .descriptor = places.next()};
      if (first >= had) store->add(batch);
    }
    const int64_t added = store->size() - had;
    std::printf("shard %zu: %ld entries added, %.0f entries/s\n", shard, added,
                double(added) / (wall_seconds() - start));
    std::fflush(stdout);
  }
}

/// In each of two processes. The first adds an entry when the other is ready, and writes when.
void measure_process(bool is_first, int socket, const RingMap& map,
                     const std::vector<std::string>& urls) {
  const FeatureExtractor extractor = descriptors_as_features(map);
  Shards shards(extractor, urls);
  Places places(map);
  std::vector<double> times;
  int64_t found = 0;  // noisy, rotated copies of entries, which are the first of shard 0
  for (int64_t q = 0; q < kQueries; ++q) {
    const int64_t entry = q * 7919 % int64_t(map.entries.size());
    const Description scan{.feature = places.copy_of(entry, 0.3F), .error = ""};
    const double start = wall_seconds();
    found += shards.query(scan) == std::pair(size_t{0}, entry);
    times.push_back(1e3 * (wall_seconds() - start));
  }
  std::printf(
      "%s: %ld entries open in %.1f s, %.0f bytes an entry, query p50 %.1f ms, p99 %.1f ms, "
      "%ld of %ld found\n",
      is_first ? "process 1" : "process 2", shards.size, shards.open,
      shards.bytes / double(shards.size), quantile(times, 0.5), quantile(times, 0.99), found,
      kQueries);
  std::fflush(stdout);
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
      shards.last().add({{.drive = "new", .frame = i, .feature = places.next()}});
      delays.push_back(1e3 * (wall_seconds() - start));
      transfer(::write);
    } else {
      const int64_t known = shards.last().size();
      transfer(::write);
      for (; shards.last().size() == known; shards.last().refresh())
        std::this_thread::sleep_for(std::chrono::microseconds(200));
      const double seen = wall_seconds();
      transfer(::read);
      delays.push_back(1e3 * (seen - start));
    }
  }
  std::printf("%s: p50 %.1f ms, p99 %.1f ms\n",
              is_first ? "add() returns" : "the other process sees the entry",
              quantile(delays, 0.5), quantile(delays, 0.99));
}

}  // namespace

void measure_server(const RingMap& map, int64_t count, const std::vector<std::string>& urls) {
  fill(map, descriptors_as_features(map), count, urls);
  int ends[2];
  if (::socketpair(AF_UNIX, SOCK_STREAM, 0, ends) != 0) throw Error("no sockets");
  for (const bool is_first : {true, false})
    if (::fork() == 0) {
      measure_process(is_first, ends[is_first ? 1 : 0], map, urls);
      std::fflush(stdout);
      std::_Exit(0);
    }
  for (int i = 0; i < 2; ++i) ::wait(nullptr);
}

}  // namespace revisit
