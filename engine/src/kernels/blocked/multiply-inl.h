// The matrix product under every blocked convolution: a panel of columns (pixels or tiles) times
// blocks of output channels, summed over blocks of input channels. Highway includes this file once
// per target.
#if defined(REVISIT_MULTIPLY_INL_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef REVISIT_MULTIPLY_INL_H_
#undef REVISIT_MULTIPLY_INL_H_
#else
#define REVISIT_MULTIPLY_INL_H_
#endif

#include <hwy/cache_control.h>

#include <algorithm>
#include <utility>

#include "kernels/blocked/block-inl.h"
#include "kernels/blocked/column_panels.h"

HWY_BEFORE_NAMESPACE();
namespace revisit::engine::HWY_NAMESPACE {

constexpr int kTileBlocks = sum_tile(kRegisters, kVectors).blocks;
constexpr int kTileColumns = sum_tile(kRegisters, kVectors).columns;

/// Factors of a product, in steps of floats.
struct Factors {
  int64_t in_blocks;        // of the sum
  const float* inputs;      // [in_blocks][columns][kLanes]
  int64_t inputs_step;      // from block to block; columns are kLanes apart
  const float* weights;     // [output block][in_blocks * kLanes][kLanes]
  int64_t weights_step;     // from output block to output block
  const float* prefetched;  // meanwhile into the cache, as much as one output block's weights
};

/// A sink that stores [output block][column][kLanes].
struct StoreProducts {
  float* to;
  int64_t step;  // from output block to output block

  HWY_INLINE void operator()(int64_t block, int64_t column, const Block& sum) const {
    store_block(sum, to + block * step + column * kLanes);
  }
};

/// Calls `sink(output block, column, sum)` for `kBlocks` x `kColumns` sums.
template <int kBlocks, int kColumns, class Sink>
void multiply_tile(const Factors& f, const Sink& sink) {
  const Tag d;
  Block sums[kBlocks][kColumns];
  REVISIT_UNROLL
  for (int b = 0; b < kBlocks; ++b) {
    REVISIT_UNROLL
    for (int c = 0; c < kColumns; ++c) sums[b][c] = zero_block();
  }
  const float* HWY_RESTRICT weights = f.weights;
  const float* HWY_RESTRICT inputs = f.inputs;
  const float* prefetched = f.prefetched;
  for (int64_t block = 0; block < f.in_blocks; ++block, inputs += f.inputs_step) {
    for (int64_t channel = 0; channel < kLanes;
         ++channel, weights += kLanes, prefetched += kLanes) {
      hwy::Prefetch(prefetched);
      hwy::Prefetch(inputs + f.inputs_step + std::min<int64_t>(channel, kColumns - 1) * kLanes);
      Block w[kBlocks];
      REVISIT_UNROLL
      for (int b = 0; b < kBlocks; ++b) w[b] = load_block(weights + b * f.weights_step);
      REVISIT_UNROLL
      for (int c = 0; c < kColumns; ++c) {
        const Vector input = hn::Set(d, inputs[c * kLanes + channel]);
        REVISIT_UNROLL
        for (int b = 0; b < kBlocks; ++b) sums[b][c] = mul_add(input, w[b], sums[b][c]);
      }
    }
  }
  REVISIT_UNROLL
  for (int b = 0; b < kBlocks; ++b) {
    REVISIT_UNROLL
    for (int c = 0; c < kColumns; ++c) sink(b, c, sums[b][c]);
  }
}

template <int kBlocks, class Sink, size_t... kIndex>
void multiply_columns(const Factors& f, int64_t columns, const Sink& sink,
                      std::index_sequence<kIndex...>) {
  using Function = void (*)(const Factors&, const Sink&);
  static constexpr Function kFunctions[] = {multiply_tile<kBlocks, kIndex + 1, Sink>...};
  kFunctions[columns - 1](f, sink);
}

/// The same for `blocks` output blocks and up to kMaxColumns columns.
template <class Sink>
void multiply(const Factors& f, int64_t blocks, int64_t columns, const Sink& sink) {
  const int64_t parts = (columns + kTileColumns - 1) / kTileColumns;
  const int64_t width = parts == 1 ? columns : (columns + parts - 1) / parts;
  for (int64_t b = 0; b < blocks; b += kTileBlocks) {
    for (int64_t first = 0; first < columns; first += width) {
      const int64_t count = std::min(width, columns - first);
      Factors here = f;
      here.weights += b * f.weights_step;
      here.inputs += first * kLanes;
      const auto shifted = [=](int block, int column, const Block& sum)
                               HWY_ATTR { sink(b + block, first + column, sum); };
      constexpr auto kColumns = std::make_index_sequence<kTileColumns>();
      if (kTileBlocks > 1 && blocks - b > 1)
        multiply_columns<kTileBlocks>(here, count, shifted, kColumns);
      else
        multiply_columns<1>(here, count, shifted, kColumns);
    }
  }
}

}  // namespace revisit::engine::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#endif  // per-target include guard
