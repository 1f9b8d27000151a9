#pragma once

#include <algorithm>
#include <cstdint>

#include "kernels/blocked/column_panels.h"
#include "kernels/pooling.h"
#include "layout.h"

namespace revisit::engine {

/// How maximum pooling is cut up where it is done with what comes before it. A piece is a strip of
/// windows side by side on a band of image rows; one row of its pixels, all channels, stays in
/// cache. Strips are as few as the cache allows: neighbours both make the columns that windows of
/// both read. Bands make each row once. A window that reaches over bands gets one maximum from
/// each, which are joined in the end; the maximum of maxima is the same bit for bit, so bands may
/// depend on the number of threads.
struct PoolingPieces {
  int64_t images;
  int64_t windows;    // of a strip
  int64_t columns;    // of the image that a strip reads, at most
  int64_t strips;     // of an image
  Split bands;        // rows of an image
  int64_t continued;  // rows of windows that reach into a band from the one above, at most
  int64_t blocks;     // of channels
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

  int64_t row_floats() const { return columns * blocks * kLanes; }  // of one row of pixels
  /// What a piece has of the windows that began above its band.
  int64_t continued_numbers() const { return continued * windows * blocks * kLanes; }
  int64_t scratch_floats() const {
    return images * strips * (bands.parts - 1) * continued_numbers() + threads * row_floats();
  }

 private:
  static int64_t ceil_div(int64_t a, int64_t b) { return (a + b - 1) / b; }

  /// The fewest bands that give every thread work, and then as much as the others, nearly.
  int64_t count_bands(int64_t rows) const {
    constexpr int64_t kTried = 4;  // times as many
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

/// Whether pooling costs less with what comes before it than after it. Wide windows of many
/// channels leave a strip few windows; then strips make the same columns again and again.
inline bool is_worth_pooling_in_pieces(const PoolingProblem& p, int64_t channels) {
  const PoolingPieces pieces(p, channels, 1);
  return 2 * pieces.strips * pieces.columns <= 3 * p.w;
}

}  // namespace revisit::engine
