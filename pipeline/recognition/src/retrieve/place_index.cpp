#include "revisit/recognition/place_index.h"

#include <algorithm>
#include <cmath>

#include "retrieve/ranking.h"
#include "revisit/proto/error.h"
#include "revisit/recognition/cosine.h"

namespace revisit::pipeline {
namespace {

constexpr int64_t kBlock = 1024;  // places

/// For cosines the descriptor at unit length is its own key, and so many more than asked for are
/// compared exactly, as the products are of floats.
constexpr int64_t kSpare = 16;

KeyOf unit_length(int64_t dim) {
  return {dim, [](std::span<const float> x, std::span<float> key) {
            const double length = length_of(x);
            const auto scale = length > 0 ? static_cast<float>(1 / length) : 0.0F;
            std::ranges::transform(x, key.begin(), [scale](float v) { return v * scale; });
          }};
}

}  // namespace

PlaceIndex::PlaceIndex(const Basis& basis) : basis_(basis) {
  if (!basis_.similarity) basis_.key_of = unit_length(basis_.dim);
}

void PlaceIndex::add(std::span<const float> descriptor) {
  if (static_cast<int64_t>(descriptor.size()) != basis_.dim)
    throw UsageError(str("PlaceIndex: expected a descriptor of ", basis_.dim, " numbers, found ",
                         descriptor.size()));
  if (!std::ranges::all_of(descriptor, [](float v) { return std::isfinite(v); }))
    throw UsageError("PlaceIndex: a descriptor holds a number that is not finite");
  const bool cosines = !basis_.similarity, keys = cosines || basis_.key_candidates > 0;
  if (size_ % kBlock == 0)
    blocks_.push_back({FloatMatrix(kBlock, basis_.dim),
                       FloatMatrix(keys ? kBlock : 0, basis_.key_of.numbers),
                       std::vector<double>(cosines ? kBlock : 0)});
  Block& block = blocks_.back();
  const int64_t row = size_ % kBlock;
  std::ranges::copy(descriptor, block.descriptors.row(row).begin());
  if (keys) basis_.key_of.make(descriptor, block.keys.row(row));
  if (cosines) block.lengths[static_cast<size_t>(row)] = length_of(descriptor);
  ++size_;
}

std::span<const float> PlaceIndex::descriptor(int64_t place) const {
  return blocks_[static_cast<size_t>(place / kBlock)].descriptors.row(place % kBlock);
}

void PlaceIndex::compare(const Block& block, std::span<const float> query, double length,
                         std::span<const int64_t> rows, std::span<double> similarities) const {
  if (basis_.similarity) return basis_.similarity(query, block.descriptors, rows, similarities);
  for (size_t i = 0; i < rows.size(); ++i)
    similarities[i] = cosine(query, length, block.descriptors.row(rows[i]),
                             block.lengths[static_cast<size_t>(rows[i])]);
}

Match PlaceIndex::best(std::span<const float> query, std::span<const CandidateRange> candidates,
                       const RetrieveOptions& options) const {
  std::vector<int64_t> places;
  for (const CandidateRange& range : candidates)
    for (int64_t place = std::max<int64_t>(range.begin, 0); place < std::min(range.end, size_);
         ++place)
      places.push_back(place);
  if (places.empty()) return {};
  const int64_t wanted =
      basis_.similarity ? basis_.key_candidates : options.k + kSpare;  // 0: all of them
  if (wanted > 0 && wanted < static_cast<int64_t>(places.size())) {
    std::vector<float> key(static_cast<size_t>(basis_.key_of.numbers)), products(places.size());
    basis_.key_of.make(query, key);
    for (size_t i = 0; i < places.size();) {
      const FloatMatrix& keys = blocks_[static_cast<size_t>(places[i] / kBlock)].keys;
      const int64_t row = places[i] % kBlock;
      size_t n = 1;  // neighbours of one block
      while (i + n < places.size() && row + static_cast<int64_t>(n) < kBlock &&
             places[i + n] == places[i] + static_cast<int64_t>(n))
        ++n;
      products_of_rows(key, keys, row, std::span(products).subspan(i, n));
      i += n;
    }
    std::vector<int64_t> chosen;
    for (const size_t i : positions_of_largest(products, wanted)) chosen.push_back(places[i]);
    places = std::move(chosen);
  }
  const double length = length_of(query);
  std::vector<int64_t> rows(places.size());
  std::ranges::transform(places, rows.begin(), [](int64_t place) { return place % kBlock; });
  std::vector<double> similarities(places.size());
  for (size_t i = 0; i < places.size();) {
    const int64_t block = places[i] / kBlock;
    size_t n = 1;
    while (i + n < places.size() && places[i + n] / kBlock == block) ++n;
    compare(blocks_[static_cast<size_t>(block)], query, length, std::span(rows).subspan(i, n),
            std::span(similarities).subspan(i, n));
    i += n;
  }
  std::vector<RankedScan> ranked;
  for (size_t i = 0; i < places.size(); ++i) ranked.emplace_back(-similarities[i], places[i]);
  return best_match(0, ranked, 1, options);
}

}  // namespace revisit::pipeline
