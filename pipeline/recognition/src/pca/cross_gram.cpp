#include "cross_gram.h"

#include <algorithm>

#include "revisit/engine/parallel_for.h"
#include "revisit/recognition/linear_algebra.h"

namespace revisit {
namespace {

constexpr int64_t kTile = 512;  // rows and columns of one product

int64_t tiles(int64_t rows) {
  return (rows + kTile - 1) / kTile;
}

}  // namespace

int64_t CrossGram::bytes(int64_t n, int64_t m, int threads) {
  const int64_t tile = std::min(kTile, n) * std::min(kTile, m);
  return n * m * static_cast<int64_t>(sizeof(double)) +
         threads * tile * static_cast<int64_t>(sizeof(float));
}

void CrossGram::add(const Panel& panel, int threads) {
  // Tiles of the fitted rows, upper triangle only; then those of the others.
  const int64_t across = tiles(m), down = across + tiles(n - m);
  const auto add_tile = [&](int64_t row_tile, int64_t column_tile) {
    const bool in_fit = row_tile < across;
    const int64_t row = in_fit ? row_tile * kTile : m + (row_tile - across) * kTile;
    const int64_t rows = std::min(kTile, (in_fit ? m : n) - row);
    const int64_t column = column_tile * kTile, columns = std::min(kTile, m - column);
    const float* const x = panel.values.data();
    std::vector<float> product(rows * columns);
    if (row == column && in_fit)
      multiply_by_own_transpose(rows, panel.width, x + row * panel.width, panel.width,
                                product.data(), columns);
    else
      multiply_transposed(rows, columns, panel.width, x + row * panel.width, panel.width,
                          x + column * panel.width, panel.width, product.data(), columns);
    double* const sums = in_fit ? fitted.data() + row * m : others.data() + (row - m) * m;
    for (int64_t r = 0; r < rows; ++r)
      for (int64_t c = row == column && in_fit ? r : 0; c < columns; ++c)
        sums[r * m + column + c] += static_cast<double>(product[r * columns + c]);
  };
  parallel_for(down * across, threads, [&](int64_t item) {
    const int64_t row_tile = item / across, column_tile = item % across;
    if (row_tile >= across || row_tile <= column_tile) add_tile(row_tile, column_tile);
  });
}

}  // namespace revisit
