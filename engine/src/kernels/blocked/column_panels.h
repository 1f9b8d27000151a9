#pragma once

#include <algorithm>
#include <cstdint>

#include "revisit/engine/parallel_for.h"

namespace revisit::engine {

/// Columns of a matrix product that are summed in registers at a time: with two blocks of output
/// channels, 28 of AVX-512's 32 registers. Targets with fewer registers use fewer columns.
constexpr int64_t kMaxColumns = 14;

struct SumTile {
  int blocks, columns;
};

/// Sums, weights of one input channel and one broadcast value must fit. A block takes `vectors`
/// registers. Enough sums must hide the latency of a fused multiply-add.
constexpr SumTile sum_tile(int registers, int vectors) {
  constexpr int kColumns = kMaxColumns;
  const int blocks = 2 * vectors * (kColumns + 1) + 1 <= registers ? 2 : 1;
  return {blocks, std::clamp((registers - 1) / (blocks * vectors) - 1, 2, kColumns)};
}

/// Columns that are multiplied together: at most `columns`, split at multiples of `unit`.
struct Panel {
  int64_t columns, unit;
};
constexpr Panel kRegisterPanel = {kMaxColumns, 1};

inline Split panels_of(int64_t columns, Panel panel = kRegisterPanel) {
  return {columns, (columns + panel.columns - 1) / panel.columns, panel.unit};
}

/// Partition of columns into chunks that fit the cache.
struct Chunks {
  Split columns;
  bool per_thread;  // true: threads process chunks independently; false: all share each chunk
};

struct Piece {
  int64_t slice, first_panel, end_panel;
};

/// A single thread takes all panels with a slice, so that it reads the slice's weights once.
class Pieces {
 public:
  Pieces(int64_t slices, int64_t panels, int sharing)
      : slices_(slices),
        cut_{panels, std::clamp(kPerThread * (sharing - 1) / slices, int64_t{1}, panels)} {}

  int64_t count() const { return slices_ * cut_.parts; }
  Piece operator[](int64_t i) const {
    const int64_t part = i % cut_.parts;
    return {i / cut_.parts, cut_.begin(part), cut_.end(part)};
  }

 private:
  static constexpr int64_t kPerThread = 2;
  int64_t slices_;
  Split cut_;
};

/// Splits `products` equal products into chunks of at most `panels` panels. If each thread gets at
/// least one chunk, all get equally many, if there are enough columns.
inline Chunks cut_into_chunks(int64_t products, int64_t columns, int64_t panels, int threads,
                              Panel panel = kRegisterPanel) {
  int64_t chunks = panels_of(columns, panel).parts;
  chunks = (chunks + panels - 1) / panels;
  if (products * chunks < threads) return {{columns, chunks, panel.unit}, false};
  const int64_t most = Split{columns, 1, panel.unit}.units();
  if (products * chunks < 4 * threads)
    while (products * chunks % threads != 0 && chunks < most) ++chunks;
  return {{columns, chunks, panel.unit}, true};
}

}  // namespace revisit::engine
