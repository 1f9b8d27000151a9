#include "revisit/maps/large_maps.h"

#include <faiss/IndexFlat.h>
#include <faiss/IndexHNSW.h>
#include <faiss/IndexIVFPQ.h>
#include <omp.h>

#include <algorithm>
#include <cmath>

#include "revisit/base/error.h"
#include "revisit/recognition/cosine.h"

namespace revisit::pipeline {
namespace {

constexpr int64_t kTogether = 4096;  // keys that are added in one call

/// FAISS takes as many threads as OpenMP has for the calling one.
class OpenMpThreads {
 public:
  explicit OpenMpThreads(int threads) : before_(omp_get_max_threads()) {
    omp_set_num_threads(threads);
  }
  ~OpenMpThreads() { omp_set_num_threads(before_); }
  OpenMpThreads(const OpenMpThreads&) = delete;
  OpenMpThreads& operator=(const OpenMpThreads&) = delete;

 private:
  int before_;
};

/// `descriptor` at unit length -> `key`, with zeros behind it.
void unit_key(std::span<const float> descriptor, std::span<float> key) {
  const double length = length_of(descriptor), scale = length > 0 ? 1 / length : 0;
  const auto end = std::ranges::transform(descriptor, key.begin(), [scale](float v) {
                     return static_cast<float>(v * scale);
                   }).out;
  std::fill(end, key.end(), 0.0F);
}

bool is_among(int64_t place, std::span<const CandidateRange> among) {
  return std::ranges::any_of(among, [place](const CandidateRange& range) {
    return place >= range.begin && place < range.end;
  });
}

class FaissSource : public CandidateSource {
 public:
  /// `index` takes keys with as many zeros behind them as it has more numbers.
  explicit FaissSource(std::unique_ptr<faiss::Index> index) : index_(std::move(index)) {}

  int64_t size() const override { return index_->ntotal; }
  void add(std::span<const float> descriptor) override { index_->add(1, key_of(descriptor)); }
  void find(std::span<const float> query, std::span<const CandidateRange> among, int64_t count, int,
            std::vector<int64_t>& places) const override {
    thread_local std::vector<float> products;
    // What is not among them, as the last places often are, may be the most similar.
    int64_t left_out = size();
    for (const CandidateRange& range : among) left_out -= range.size();
    const int64_t asked = std::min(count + std::min(left_out, count), size());
    products.resize(static_cast<size_t>(asked));
    places.resize(static_cast<size_t>(asked));
    index_->search(1, key_of(query), asked, products.data(), places.data());
    std::erase_if(places, [among](int64_t place) { return !is_among(place, among); });  // -1: none
  }

 private:
  const float* key_of(std::span<const float> descriptor) const {
    thread_local std::vector<float> key;
    key.resize(static_cast<size_t>(index_->d));
    unit_key(descriptor, key);
    return key.data();
  }

  std::unique_ptr<faiss::Index> index_;
};

/// Every `step`-th key from `first` on, `count` of them, each with zeros up to `d` numbers.
FloatMatrix some_keys(const PlaceIndex& index, int64_t d, int64_t first, int64_t count,
                      int64_t step) {
  FloatMatrix keys(count, d);
  for (int64_t i = 0; i < count; ++i) unit_key(index.descriptor(first + i * step), keys.row(i));
  return keys;
}

std::unique_ptr<CandidateSource> filled(std::unique_ptr<faiss::Index> empty,
                                        const PlaceIndex& index) {
  for (int64_t first = 0; first < index.size(); first += kTogether) {
    const int64_t count = std::min(kTogether, index.size() - first);
    empty->add(count, some_keys(index, empty->d, first, count, 1).values.data());
  }
  return std::make_unique<FaissSource>(std::move(empty));
}

void check(const PlaceIndex& index, int64_t least) {
  if (!index.by_cosine())
    throw UsageError("candidates of a large map: its descriptors are not compared by cosine");
  if (index.size() < least)
    throw UsageError(str("candidates of a large map: expected at least ", least, " places, found ",
                         index.size()));
}

int64_t numbers_of(const PlaceIndex& index) {
  return static_cast<int64_t>(index.descriptor(0).size());
}

void check_positive(const char* what, int value) {
  if (value < 1) throw UsageError(str(what, ": expected at least 1, found ", value));
}

}  // namespace

std::unique_ptr<CandidateSource> graph_of_keys(const PlaceIndex& index,
                                               const GraphOptions& options) {
  check(index, 1);
  if (options.links < 2)
    throw UsageError(str("graph of keys, links: expected at least 2, found ", options.links));
  check_positive("graph of keys, build_effort", options.build_effort);
  check_positive("graph of keys, search_effort", options.search_effort);
  check_positive("graph of keys, threads", options.threads);
  const OpenMpThreads threads(options.threads);
  auto graph = std::make_unique<faiss::IndexHNSWSQ>(static_cast<int>(numbers_of(index)),
                                                    faiss::ScalarQuantizer::QT_fp16, options.links,
                                                    faiss::METRIC_INNER_PRODUCT);
  graph->hnsw.efConstruction = options.build_effort;
  graph->hnsw.efSearch = options.search_effort;
  graph->train(1, some_keys(index, graph->d, 0, 1, 1).values.data());  // float16 learns nothing
  return filled(std::move(graph), index);
}

std::unique_ptr<CandidateSource> lists_of_keys(const PlaceIndex& index,
                                               const ListOptions& options) {
  constexpr int64_t kCodes = 256, kKeysPerCentre = 64;
  check(index, kCodes);
  if (options.lists < 0 || options.lists > index.size())
    throw UsageError(
        str("lists of keys, lists: expected 0 to ", index.size(), ", found ", options.lists));
  check_positive("lists of keys, probes", options.probes);
  check_positive("lists of keys, numbers_per_byte", options.numbers_per_byte);
  check_positive("lists of keys, threads", options.threads);
  const OpenMpThreads threads(options.threads);
  const int64_t bytes =
                    (numbers_of(index) + options.numbers_per_byte - 1) / options.numbers_per_byte,
                d = bytes * options.numbers_per_byte;
  const int64_t n_lists =
      options.lists > 0
          ? options.lists
          : static_cast<int64_t>(std::lround(std::sqrt(static_cast<double>(index.size()))));
  auto centres = std::make_unique<faiss::IndexFlatIP>(d);
  auto lists = std::make_unique<faiss::IndexIVFPQ>(
      centres.get(), static_cast<size_t>(d), static_cast<size_t>(n_lists),
      static_cast<size_t>(bytes), 8, faiss::METRIC_INNER_PRODUCT);
  lists->own_fields = true;
  centres.release();  // it is the lists' now
  lists->nprobe = static_cast<size_t>(options.probes);
  // FAISS complains on the standard error about few examples.
  lists->cp.min_points_per_centroid = lists->pq.cp.min_points_per_centroid = 1;
  const int64_t step =
      std::max<int64_t>(1, index.size() / (kKeysPerCentre * std::max(n_lists, kCodes)));
  const FloatMatrix examples = some_keys(index, d, 0, index.size() / step, step);
  lists->train(examples.n, examples.values.data());
  return filled(std::move(lists), index);
}

}  // namespace revisit::pipeline
