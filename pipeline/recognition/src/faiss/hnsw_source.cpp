#include <faiss/IndexHNSW.h>
#include <omp.h>

#include <algorithm>

#include "revisit/base/error.h"
#include "revisit/recognition/matrix.h"
#include "revisit/recognition/place_index.h"

namespace revisit {
namespace {

constexpr int64_t kBatch = 4096;
constexpr int kM = 16;  // edges of a node; the lowest layer has 2 M
constexpr int kEfConstruction = 80;
constexpr int kEfSearch = 160;  // FAISS uses at least the number of results

/// Restores the number of OpenMP threads, which FAISS uses.
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

void unit_key(std::span<const float> descriptor, std::span<float> key) {
  const double length = length_of(descriptor), scale = length > 0 ? 1 / length : 0;
  std::ranges::transform(descriptor, key.begin(),
                         [scale](float v) { return static_cast<float>(v * scale); });
}

bool is_among(int64_t entry, std::span<const CandidateRange> among) {
  return std::ranges::any_of(among, [entry](const CandidateRange& range) {
    return entry >= range.begin && entry < range.end;
  });
}

class FaissSource : public CandidateSource {
 public:
  explicit FaissSource(std::unique_ptr<faiss::Index> index) : index_(std::move(index)) {}

  int64_t size() const override { return index_->ntotal; }
  void add(std::span<const float> descriptor) override { index_->add(1, key_of(descriptor)); }
  void find(std::span<const float> query, std::span<const CandidateRange> among, int64_t count, int,
            std::vector<int64_t>& entries) const override {
    thread_local std::vector<float> products;
    // Entries outside `among`, often the most recent, may be the most similar: request more.
    int64_t excluded = size();
    for (const CandidateRange& range : among) excluded -= range.size();
    const int64_t requested = std::min(count + std::min(excluded, count), size());
    products.resize(static_cast<size_t>(requested));
    entries.resize(static_cast<size_t>(requested));
    index_->search(1, key_of(query), requested, products.data(), entries.data());
    std::erase_if(entries, [among](int64_t entry) { return !is_among(entry, among); });  // -1: none
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

FloatMatrix some_keys(const PlaceIndex& index, int64_t first, int64_t count) {
  FloatMatrix keys(count, std::ssize(index.descriptor(0)));
  for (int64_t i = 0; i < count; ++i) unit_key(index.descriptor(first + i), keys.row(i));
  return keys;
}

}  // namespace

std::unique_ptr<CandidateSource> make_hnsw_source(const PlaceIndex& index, int threads) {
  if (!index.by_cosine())
    throw UsageError("candidates of a large map: its descriptors are not compared by cosine");
  if (index.size() == 0) throw UsageError("candidates of a large map: it has no entries");
  const OpenMpThreads for_build(threads);
  auto graph = std::make_unique<faiss::IndexHNSWSQ>(static_cast<int>(index.descriptor(0).size()),
                                                    faiss::ScalarQuantizer::QT_fp16, kM,
                                                    faiss::METRIC_INNER_PRODUCT);
  graph->hnsw.efConstruction = kEfConstruction;
  graph->hnsw.efSearch = kEfSearch;
  // Required by FAISS; float16 has no parameters.
  graph->train(1, some_keys(index, 0, 1).values.data());
  for (int64_t first = 0; first < index.size(); first += kBatch) {
    const int64_t count = std::min(kBatch, index.size() - first);
    graph->add(count, some_keys(index, first, count).values.data());
  }
  return std::make_unique<FaissSource>(std::move(graph));
}

}  // namespace revisit
