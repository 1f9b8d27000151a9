#pragma once

#include <algorithm>
#include <cstdint>

#include "kernels/blocked/column_panels.h"
#include "kernels/pooling.h"
#include "layout.h"

namespace revisit::engine {

/// A piece is a strip of adjacent windows on a band of image rows; one row of its pixels with all
/// channels fits the cache. There are as few strips as the cache permits, because adjacent strips
/// both compute the columns that they share. Each row is computed by one band. Windows that span
/// bands get a maximum from each, merged at the end. The maximum of maxima is bitwise equal, so
/// bands may depend on the number of threads.
struct PoolingPieces {
  int64_t images;
  int64_t windows;    // per strip
  int64_t columns;    // maximum image columns that a strip reads
  int64_t strips;     // per image
  Split bands;        // rows of an image
  int64_t continued;  // maximum rows of windows that reach into a band from above
  int64_t blocks;     // channel blocks
  int threads;

  PoolingPieces(const PoolingProblem& p, int64_t channels, int n_threads)
      : images(p.planes / channels), blocks(channel_blocks(channels)), threads(n_threads) {
    constexpr int64_t kRowFloats = 16384;
    const int64_t wanted = kRowFloats / padded_channels(channels);
    const int64_t most = std::clamp<int64_t>((wanted - p.kernel_w) / p.stride_w + 1, 1, p.out_w);
    windows = ceil_div(p.out_w, ceil_div(p.out_w, most));
    columns = std::min((windows - 1) * p.stride_w + p.kernel_w, p.w);
    strips = ceil_div(p.out_w, windows);
    bands = {p.h, count_bands(p.h)};
    continued = std::min(ceil_div(p.kernel_h - 1, p.stride_h), p.out_h);
  }

  int64_t count() const { return images * strips * bands.parts; }

  int64_t row_floats() const { return columns * blocks * kLanes; }
  int64_t continued_numbers() const { return continued * windows * blocks * kLanes; }
  int64_t scratch_floats() const {
    return images * strips * (bands.parts - 1) * continued_numbers() + threads * row_floats();
  }

 private:
  static int64_t ceil_div(int64_t a, int64_t b) { return (a + b - 1) / b; }

  /// Fewest bands that give all threads nearly equal work.
  int64_t count_bands(int64_t rows) const {
    constexpr int64_t kTried = 4;  // maximum multiple of the fewest bands
    const int64_t fewest = std::clamp<int64_t>(ceil_div(threads, images * strips), 1, rows);
    int64_t best = fewest, best_rows = INT64_MAX;
    for (int64_t n = fewest; n <= std::min(kTried * fewest, rows); ++n) {
      const int64_t rounds = ceil_div(images * strips * n, threads);
      const int64_t rows_of_a_thread = rounds * ceil_div(rows, n);
      if (rows_of_a_thread >= best_rows) continue;
      best = n;
      best_rows = rows_of_a_thread;
    }
    return best;
  }
};

/// Rejects wide windows on many channels, where strips compute the same columns repeatedly.
inline bool is_worth_pooling_in_pieces(const PoolingProblem& p, int64_t channels) {
  const PoolingPieces pieces(p, channels, 1);
  return 2 * pieces.strips * pieces.columns <= 3 * p.w;
}

}  // namespace revisit::engine
