#include "ring/codes.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "retrieve/shortlist.h"
#include "revisit/engine/parallel_for.h"

namespace revisit {
namespace {

/// Complex coefficients of a code, if a descriptor has as many.
constexpr int64_t kCodeCoefficients = 128;
constexpr size_t kNone = std::numeric_limits<size_t>::max();
static_assert(kEntriesPerBlock % kCodesPerGroup == 0);

/// Two coefficients of frequency 0, which are real, make one complex coefficient.
int64_t coefficients_of(const RingLayout& layout, size_t f) {
  return f > 0 ? layout[f] : (layout[f] + 1) / 2;
}

}  // namespace

struct RingCodes::Memory {
  struct Part {
    Shortlist shortlist;
    std::array<float, kEntriesPerBlock> similarities;
  };
  CodeQuery query;
  std::vector<Part> parts;
};

RingCodes::RingCodes(const RingLayout& layout) {
  int64_t all = 0;
  for (size_t f = 0; f < layout.size(); ++f) all += coefficients_of(layout, f);
  size_t first = 0;
  for (size_t f = 0; f < layout.size(); ++f) {
    const int64_t count = coefficients_of(layout, f);
    const int64_t taken =
        all <= kCodeCoefficients ? count : (count * kCodeCoefficients + all / 2) / all;
    const auto parts = static_cast<size_t>(layout[f]);
    for (int64_t i = 0; i < taken; ++i) {
      const auto coefficient = static_cast<size_t>(i * count / taken);
      if (f > 0)
        coefficients_.push_back({first + coefficient, first + parts + coefficient});
      else  // the product of two has the correct real part
        coefficients_.push_back(
            {2 * coefficient, 2 * coefficient + 1 < parts ? 2 * coefficient + 1 : kNone});
    }
    counts_[f] = static_cast<int>(taken);
    first += f > 0 ? 2 * parts : parts;
  }
  const int most = std::max(1, *std::ranges::max_element(counts_));
  largest_of_query_ = std::numeric_limits<int16_t>::max() / (2 * kMaxPart * most);
}

float RingCodes::round_parts(std::span<const float> descriptor, int largest,
                             std::span<int16_t> parts) const {
  const auto part = [descriptor](size_t at) {
    return at == kNone ? 0.0 : static_cast<double>(descriptor[at]);
  };
  double most = 0;
  for (const auto& coefficient : coefficients_)
    for (const size_t at : coefficient) most = std::max(most, std::abs(part(at)));
  const double scale = most > 0 ? largest / most : 0;
  auto to = parts.begin();
  for (const auto& coefficient : coefficients_)
    for (const size_t at : coefficient) *to++ = static_cast<int16_t>(std::lround(part(at) * scale));
  return static_cast<float>(most / largest);
}

void RingCodes::add(std::span<const float> descriptor) {
  const size_t coefficients = coefficients_.size();
  const auto row = static_cast<size_t>(size_ % kEntriesPerBlock);
  if (row == 0) {
    const size_t bytes = coefficients * kEntriesPerBlock;
    blocks_.push_back({hwy::AllocateAligned<uint8_t>(bytes), std::vector<float>(kEntriesPerBlock)});
    std::fill_n(blocks_.back().codes.get(), bytes, uint8_t{0});
  }
  std::vector<int16_t> parts(2 * coefficients);
  Block& block = blocks_.back();
  block.scales[row] = round_parts(descriptor, kMaxPart, parts);
  uint8_t* const code = block.codes.get() + row / kCodesPerGroup * kCodesPerGroup * coefficients +
                        row % kCodesPerGroup;
  for (size_t i = 0; i < coefficients; ++i)
    code[i * kCodesPerGroup] = static_cast<uint8_t>((parts[2 * i] & 15) | (parts[2 * i + 1] << 4));
  ++size_;
}

void RingCodes::find(std::span<const float> query, std::span<const CandidateRange> among,
                     int64_t count, int threads, std::vector<int64_t>& places) const {
  thread_local Memory memory_of_this_thread;
  Memory& memory = memory_of_this_thread;
  memory.query.counts = counts_;
  memory.query.parts.resize(2 * coefficients_.size());
  round_parts(query, largest_of_query_, memory.query.parts);

  const int64_t n_places = places_of(among),
                n_parts = std::clamp<int64_t>(n_places / kEntriesPerBlock, 1, threads);
  if (memory.parts.size() < static_cast<size_t>(n_parts))
    memory.parts.resize(static_cast<size_t>(n_parts));
  parallel_for(n_parts, threads, [&](int64_t i) {
    Memory::Part& part = memory.parts[static_cast<size_t>(i)];
    part.shortlist.begin(count, 0);
    for_each_run(among, n_places * i / n_parts, n_places * (i + 1) / n_parts, kEntriesPerBlock,
                 [&](int64_t place, int64_t n) {
                   // Round down and up to whole groups of interleaved codes.
                   const auto row = static_cast<size_t>(place % kEntriesPerBlock),
                              first = row / kCodesPerGroup * kCodesPerGroup,
                              end = row + static_cast<size_t>(n),
                              compared = (end - first + kCodesPerGroup - 1) / kCodesPerGroup *
                                         kCodesPerGroup;
                   const Block& block = blocks_[static_cast<size_t>(place / kEntriesPerBlock)];
                   max_code_products(memory.query, block.codes.get() + first * coefficients_.size(),
                                     std::span(block.scales).subspan(first, compared),
                                     std::span(part.similarities).first(compared));
                   for (size_t at = row; at < end; ++at)
                     part.shortlist.offer(part.similarities[at - first], place++);
                 });
  });
  Shortlist& chosen = memory.parts.front().shortlist;
  for (size_t i = 1; i < static_cast<size_t>(n_parts); ++i) chosen.offer(memory.parts[i].shortlist);
  places.clear();
  for (const Shortlist::Entry& entry : chosen.finish()) places.push_back(entry.position);
}

}  // namespace revisit
