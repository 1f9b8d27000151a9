#include "revisit/recognition/place_index.h"

#include <algorithm>
#include <cmath>

#include "retrieve/shortlist.h"
#include "revisit/recognition/matrix.h"

namespace revisit {

double Comparison::similarity_of(std::span<const float> a, std::span<const float> b) const {
  if (!similarity) return cosine(a, length_of(a), b, length_of(b));
  double similarity_found = 0;
  similarity(a, {&b, 1}, {&similarity_found, 1});
  return similarity_found;
}

PlaceIndex::PlaceIndex(int64_t dim, Comparison comparison)
    : dim_(dim), comparison_(std::move(comparison)) {
  if (comparison_.candidates > 0 && comparison_.make_codes)
    set_candidate_source(comparison_.make_codes(), comparison_.candidates);
}

void PlaceIndex::check(std::span<const float> descriptor, const char* what) const {
  if (static_cast<int64_t>(descriptor.size()) != dim_)
    throw UsageError(
        str("PlaceIndex: expected a ", what, " of ", dim_, " values, found ", descriptor.size()));
  if (!std::ranges::all_of(descriptor, [](float v) { return std::isfinite(v); }))
    throw UsageError("PlaceIndex: a ", what, " has a value that is not finite");
}

PlaceIndex::Block& PlaceIndex::block_to_add_to() {
  if (static_cast<int64_t>(blocks_.size()) * kEntriesPerBlock == size_) {
    // Without a source, every query reads all of them.
    if (!blocks_.empty() && source_) spill(blocks_.back());
    blocks_.push_back({.copies = {},
                       .rows = std::vector<const float*>(kEntriesPerBlock),
                       .lengths = std::vector<double>(by_cosine() ? kEntriesPerBlock : 0),
                       .in_file = {}});
  }
  return blocks_.back();
}

/// Moves a block to the file, if all descriptors are copies and the file can be written.
void PlaceIndex::spill(Block& block) {
  for (int64_t i = 0; i < kEntriesPerBlock; ++i)
    if (block.copies.n == 0 || block.rows[static_cast<size_t>(i)] != block.copies.row(i).data())
      return;
  try {
    if (!file_) file_ = std::make_unique<UnnamedFile>();
    block.in_file = file_->append(std::as_bytes(std::span(block.copies.values)));
  } catch (const Error&) {
    return;
  }
  block.copies = {};
  block.rows = {};
}

const PlaceIndex::Block& PlaceIndex::block_of(int64_t place) const {
  return blocks_[static_cast<size_t>(place / kEntriesPerBlock)];
}

void PlaceIndex::add(std::span<const float> descriptor) {
  check(descriptor, "descriptor");
  Block& block = block_to_add_to();
  if (block.copies.n == 0) block.copies = FloatMatrix(kEntriesPerBlock, dim_);
  const std::span<float> copy = block.copies.row(size_ % kEntriesPerBlock);
  std::ranges::copy(descriptor, copy.begin());
  add_view(copy);
}

void PlaceIndex::add_view(std::span<const float> descriptor) {
  check(descriptor, "descriptor");
  Block& block = block_to_add_to();
  const int64_t row = size_ % kEntriesPerBlock;
  block.rows[static_cast<size_t>(row)] = descriptor.data();
  if (by_cosine()) block.lengths[static_cast<size_t>(row)] = length_of(descriptor);
  if (source_) source_->add(descriptor);
  ++size_;
}

const float* PlaceIndex::in_memory(int64_t place, int64_t n) const {
  const Block& block = block_of(place);
  if (block.in_file) return nullptr;
  const auto rows =
      std::span(block.rows)
          .subspan(static_cast<size_t>(place % kEntriesPerBlock), static_cast<size_t>(n));
  const auto apart = [this](const float* a, const float* b) { return b != a + dim_; };
  return std::ranges::adjacent_find(rows, apart) == rows.end() ? rows.front() : nullptr;
}

void PlaceIndex::copy(int64_t place, int64_t n, std::span<float> to) const {
  const Block& block = block_of(place);
  const int64_t first = place % kEntriesPerBlock;
  if (block.in_file) {
    const auto bytes_before = first * dim_ * static_cast<int64_t>(sizeof(float));
    file_->read(*block.in_file + bytes_before, std::as_writable_bytes(to));
    return;
  }
  for (int64_t i = 0; i < n; ++i)
    std::copy_n(block.rows[static_cast<size_t>(first + i)], dim_, to.begin() + i * dim_);
}

std::vector<float> PlaceIndex::descriptor(int64_t place) const {
  std::vector<float> descriptor(static_cast<size_t>(dim_));
  copy(place, 1, descriptor);
  return descriptor;
}

double PlaceIndex::similarity(std::span<const float> query, int64_t place) const {
  check(query, "descriptor");
  return comparison_.similarity_of(query, descriptor(place));
}

std::optional<double> PlaceIndex::relative_yaw(std::span<const float> query, int64_t place) const {
  check(query, "descriptor");
  if (!comparison_.relative_yaw) return std::nullopt;
  return comparison_.relative_yaw(descriptor(place), query);
}

void PlaceIndex::set_candidate_source(std::unique_ptr<CandidateSource> source, int64_t count) {
  if (source->size() != size_)
    throw UsageError(
        str("PlaceIndex: expected a source of ", size_, " places, found ", source->size()));
  if (count < 1) throw UsageError("PlaceIndex: expected at least 1 candidate, found ", count);
  source_ = std::move(source);
  from_source_ = count;
}

}  // namespace revisit
