// Matrix product of all NCHWc convolutions: a panel of columns (pixels or tiles) times blocks of
// output channels, in registers or in AMX tiles. Included once per target.
#if defined(REVISIT_MULTIPLY_INL_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef REVISIT_MULTIPLY_INL_H_
#undef REVISIT_MULTIPLY_INL_H_
#else
#define REVISIT_MULTIPLY_INL_H_
#endif

#include <hwy/cache_control.h>

#include <algorithm>
#include <cstring>
#include <type_traits>
#include <utility>

#include "kernels/blocked/block-inl.h"
#include "kernels/blocked/partition.h"

HWY_BEFORE_NAMESPACE();
namespace revisit::engine::HWY_NAMESPACE {

constexpr int kTileBlocks = sum_tile(kRegisters, kVectors).blocks;
constexpr int kTileColumns = sum_tile(kRegisters, kVectors).columns;

/// With many columns a channel has time for two prefetches. With few, what the next block of
/// channels needs is prefetched at once.
constexpr bool kPrefetchesSteadily = kTileColumns == kMaxColumns;

/// Input channels per multiplication: one float32, or two bfloat16 in 4 bytes. Strides count
/// numbers of type T; weights of `kStep` channels are [kLanes][kStep].
template <class T>
constexpr int64_t kStep = std::is_same_v<T, float> ? 1 : 2;
template <class T>
constexpr int64_t kLine = kLanes* kStep<T>;

HWY_INLINE Vector broadcast(const float* channel) {
  return hn::Set(Tag(), *channel);
}

HWY_INLINE Vector broadcast(const BFloat16* channels) {
  uint32_t pair;
  std::memcpy(&pair, channels, sizeof(pair));
  return hn::BitCast(Tag(), hn::Set(Bits(), pair));
}

HWY_INLINE Block load_weights(const float* weights) {
  return load_block(weights);
}

HWY_INLINE Block load_weights(const BFloat16* weights) {
  Block r;
  REVISIT_UNROLL
  for (int i = 0; i < kVectors; ++i) {
    const uint16_t* const halves = &weights[2 * i * kVectorLanes].bits;
    r.v[i] = hn::BitCast(Tag(), hn::Load(hn::Repartition<uint16_t, Tag>(), halves));
  }
  return r;
}

HWY_INLINE Block add_products(float /*type*/, Vector input, const Block& weights, Block sum) {
  return mul_add(input, weights, sum);
}

HWY_INLINE Vector odd_half(Vector pair) {
  const Bits d;
  return hn::BitCast(Tag(), hn::And(hn::BitCast(d, pair), hn::Set(d, 0xFFFF0000)));
}

HWY_INLINE Vector even_half(Vector pair) {
  return hn::BitCast(Tag(), hn::ShiftLeft<16>(hn::BitCast(Bits(), pair)));
}

/// Both variants are bitwise equal, because a product of two BFloat16 is exact.
HWY_INLINE Block add_products(BFloat16 /*type*/, Vector input, const Block& weights, Block sum) {
#if HWY_ARCH_X86 && HWY_TARGET <= HWY_AVX3
  asm("vdpbf16ps %2, %1, %0" : "+v"(sum.v[0].raw) : "v"(weights.v[0].raw), "v"(input.raw));
#else
  REVISIT_UNROLL
  for (int i = 0; i < kVectors; ++i) {
    const Vector odd = hn::MulAdd(odd_half(input), odd_half(weights.v[i]), sum.v[i]);
    sum.v[i] = hn::MulAdd(even_half(input), even_half(weights.v[i]), odd);
  }
#endif
  return sum;
}

template <class T, int kBlocks, int kColumns>
HWY_INLINE void add_column(const T* pixel, const Block (&weights)[kBlocks], int column,
                           Block (&sums)[kBlocks][kColumns]) {
  const Vector input = broadcast(pixel);
  REVISIT_UNROLL
  for (int b = 0; b < kBlocks; ++b)
    sums[b][column] = add_products(T(), input, weights[b], sums[b][column]);
}

/// Strides count numbers of type T.
template <class T>
struct Factors {
  int64_t in_blocks;
  const T* inputs;       // [in_blocks][columns][kLanes]
  int64_t inputs_step;   // stride of blocks; the stride of columns is kLanes
  const T* weights;      // [output block][in_blocks * kLanes / kStep][kLanes][kStep]
  int64_t weights_step;  // stride of output blocks
  const T* prefetched;   // to prefetch, as much as one output block's weights; `weights`: nothing
  const T* next;         // to prefetch: the first inputs of the next product
  int64_t last_channels = kLanes;  // of the last block; the others are zeros
  int64_t prefetched_lines = 0;  // per block of inputs, if it prefetches at once; set by multiply()
};

struct StoreProducts {
  float* to;
  int64_t step;  // stride of output blocks

  template <int kCount>
  HWY_INLINE void operator()(int64_t block, int64_t column, const Block (&sums)[kCount]) const {
    REVISIT_UNROLL
    for (int i = 0; i < kCount; ++i)
      store_block(sums[i], to + block * step + (column + i) * kLanes);
  }
  template <int kBlocks, int kColumns>
  HWY_INLINE void prefetch(int64_t, int64_t) const {}
};

/// Calls `sink(output block, first column, sums)` block by block. The sink may modify the sums.
/// Before, it calls `sink.prefetch(output block, column)`.
template <int kBlocks, int kColumns, class T, class Sink>
void multiply_tile(const Factors<T>& f, int64_t first_block, int64_t first_column,
                   const Sink& sink) {
  Block sums[kBlocks][kColumns];
  REVISIT_UNROLL
  for (int b = 0; b < kBlocks; ++b) {
    REVISIT_UNROLL
    for (int c = 0; c < kColumns; ++c) sums[b][c] = zero_block();
  }
  const T* HWY_RESTRICT weights = f.weights;
  const T* HWY_RESTRICT inputs = f.inputs;
  const T* prefetched = f.prefetched;
  for (int64_t block = 0; block < f.in_blocks; ++block, inputs += f.inputs_step) {
    const bool last = block + 1 == f.in_blocks;
    const T* const next = last ? f.next : inputs + f.inputs_step;
    if (last) sink.template prefetch<kBlocks, kColumns>(first_block, first_column);
    if constexpr (!kPrefetchesSteadily) {
      for (int c = 0; c < kColumns; ++c) hwy::Prefetch(next + c * kLanes);
      for (int64_t i = 0; i < f.prefetched_lines; ++i, prefetched += kLine<T>)
        hwy::Prefetch(prefetched);
    }
    const int64_t channels = last ? f.last_channels : kLanes;
    for (int64_t channel = 0; channel < channels; channel += kStep<T>, weights += kLine<T>) {
      if constexpr (kPrefetchesSteadily) {
        hwy::Prefetch(prefetched);
        prefetched += kLine<T>;
        const int64_t column = std::min<int64_t>(channel, kColumns - 1);
        hwy::Prefetch(next + column * kLanes);
      }
      Block w[kBlocks];
      REVISIT_UNROLL
      for (int b = 0; b < kBlocks; ++b) w[b] = load_weights(weights + b * f.weights_step);
      REVISIT_UNROLL
      for (int c = 0; c < kColumns; ++c) add_column(inputs + c * kLanes + channel, w, c, sums);
    }
  }
  REVISIT_UNROLL
  for (int b = 0; b < kBlocks; ++b) sink(first_block + b, first_column, sums[b]);
}

template <int kBlocks, class T, class Sink, size_t... kIndex>
void multiply_columns(const Factors<T>& f, int64_t columns, int64_t first_block,
                      int64_t first_column, const Sink& sink, std::index_sequence<kIndex...>) {
  using Function = void (*)(const Factors<T>&, int64_t, int64_t, const Sink&);
  static constexpr Function kFunctions[] = {multiply_tile<kBlocks, kIndex + 1, T, Sink>...};
  kFunctions[columns - 1](f, first_block, first_column, sink);
}

/// Like multiply_tile(), for `blocks` output blocks and any number of columns. Each tile prefetches
/// its part of the weights, and the inputs of the next.
template <class T, class Sink>
void multiply(const Factors<T>& f, int64_t blocks, int64_t columns, const Sink& sink) {
  const Split tiles = {columns, (columns + kTileColumns - 1) / kTileColumns};
  const int64_t lines = (kLanes / kStep<T> + tiles.parts - 1) / tiles.parts;
  for (int64_t b = 0; b < blocks; b += kTileBlocks) {
    for (int64_t tile = 0; tile < tiles.parts; ++tile) {
      const int64_t first = tiles.begin(tile), end = tiles.end(tile);
      Factors<T> here = f;
      here.weights += b * f.weights_step;
      here.inputs += first * kLanes;
      if (end < columns) here.next = f.inputs + end * kLanes;
      here.prefetched_lines = f.prefetched == f.weights ? 0 : lines;
      here.prefetched += tile * here.prefetched_lines * f.in_blocks * kLine<T>;
      constexpr auto kColumns = std::make_index_sequence<kTileColumns>();
      if (kTileBlocks > 1 && blocks - b > 1)
        multiply_columns<kTileBlocks>(here, end - first, b, first, sink, kColumns);
      else
        multiply_columns<1>(here, end - first, b, first, sink, kColumns);
    }
  }
}

constexpr int64_t kTileNumbers = kTileRows * kTileDepth;

#if HWY_ARCH_X86_64 && HWY_TARGET <= HWY_AVX3
/// Configures the calling thread's tiles for its lifetime.
class Tiles {
 public:
  HWY_INLINE Tiles() {
    struct alignas(64) Configuration {
      uint8_t palette = 1, start_row = 0, reserved[14] = {};
      uint16_t row_bytes[16] = {64, 64, 64, 64, 64, 64, 64, 64};
      uint8_t rows[16] = {16, 16, 16, 16, 16, 16, 16, 16};
    };
    const Configuration whole;
    asm volatile("ldtilecfg %0" ::"m"(whole));
  }
  HWY_INLINE ~Tiles() { asm volatile("tilerelease"); }
  Tiles(const Tiles&) = delete;
  Tiles& operator=(const Tiles&) = delete;

  template <int kTile>
  HWY_INLINE void zero() {
    asm volatile("tilezero %%tmm%c0" ::"i"(kTile));
  }

  template <int kTile>
  HWY_INLINE void load(const BFloat16* from, int64_t step) {
    asm volatile("tileloadd (%0,%1,2), %%tmm%c2" ::"r"(from), "r"(step), "i"(kTile) : "memory");
  }

  template <int kSum, int kPixels, int kWeights>
  HWY_INLINE void add_products() {
    asm volatile("tdpbf16ps %%tmm%c2, %%tmm%c1, %%tmm%c0" ::"i"(kSum), "i"(kPixels), "i"(kWeights));
  }

  template <int kTile>
  HWY_INLINE void store(float* to) const {
    asm volatile("tilestored %%tmm%c2, (%0,%1,4)" ::"r"(to), "r"(kLanes), "i"(kTile) : "memory");
  }
};
#else
/// Emulation of eight registers with kTileRows rows of 64 bytes, following Intel's manual (Software
/// Developer's Manual, volume 2, TDPBF16PS). A product of two tiles sums even and odd channels
/// separately from zero. It adds both sums, then the previous value.
class Tiles {
 public:
  HWY_INLINE Tiles() {}

  template <int kTile>
  HWY_INLINE void zero() {
    for (Block& row : sums_[kTile]) row = zero_block();
  }

  template <int kTile>
  HWY_INLINE void load(const BFloat16* from, int64_t step) {
    factors_[kTile] = {from, step};
  }

  template <int kSum, int kPixels, int kWeights>
  HWY_INLINE void add_products() {
    const Factor &pixels = factors_[kPixels], &weights = factors_[kWeights];
    for (int64_t row = 0; row < kTileRows; ++row) {
      Block even = zero_block(), odd = zero_block();
      for (int64_t pair = 0; pair < kTileDepth / 2; ++pair) {
        const Vector input = broadcast(pixels.rows + row * pixels.step + 2 * pair);
        const Block w = load_weights(weights.rows + pair * weights.step);
        REVISIT_UNROLL
        for (int i = 0; i < kVectors; ++i) {
          even.v[i] = hn::MulAdd(even_half(input), even_half(w.v[i]), even.v[i]);
          odd.v[i] = hn::MulAdd(odd_half(input), odd_half(w.v[i]), odd.v[i]);
        }
      }
      sums_[kSum][row] = sums_[kSum][row] + (even + odd);
    }
  }

  /// Writes [kTileRows][kLanes].
  template <int kTile>
  HWY_INLINE void store(float* to) const {
    for (int64_t row = 0; row < kTileRows; ++row) store_block(sums_[kTile][row], to + row * kLanes);
  }

 private:
  struct Factor {
    const BFloat16* rows;
    int64_t step;
  };
  Block sums_[4][kTileRows];
  Factor factors_[8];
};
#endif

struct TileBf16 : BFloat16 {};
template <class T>
constexpr bool kInTiles = std::is_same_v<T, TileBf16>;

/// Factors of a product, in steps of kTileDepth channels.
struct TileFactors {
  int64_t steps;
  const BFloat16* inputs;  // kTileDepth per step and column; columns padded to full tiles
  int64_t inputs_step;     // stride of steps
  int64_t column_step;
  const BFloat16* weights;  // [output block][steps][kTileDepth / 2][kLanes][2]
  int64_t weights_step;     // stride of output blocks
};

/// Writes [kBlocks][kRowTiles * kTileRows][kLanes].
template <int kRowTiles, int kBlocks>
void sum_tiles(const TileFactors& f, Tiles& tiles, float* sums) {
  const auto for_each_sum = [&](const auto& work) HWY_ATTR {
    work(std::integral_constant<int, 0>());
    if constexpr (kBlocks > 1) work(std::integral_constant<int, 1>());
    if constexpr (kRowTiles > 1) work(std::integral_constant<int, 2>());
    if constexpr (kRowTiles > 1 && kBlocks > 1) work(std::integral_constant<int, 3>());
  };
  for_each_sum([&](auto sum) HWY_ATTR { tiles.template zero<sum>(); });
  const BFloat16* inputs = f.inputs;
  const BFloat16* weights = f.weights;
  for (int64_t step = 0; step < f.steps; ++step, inputs += f.inputs_step, weights += kTileNumbers) {
    tiles.template load<4>(inputs, f.column_step);
    if constexpr (kRowTiles > 1)
      tiles.template load<5>(inputs + kTileRows * f.column_step, f.column_step);
    tiles.template load<6>(weights, kTileDepth);
    if constexpr (kBlocks > 1) tiles.template load<7>(weights + f.weights_step, kTileDepth);
    for_each_sum([&](auto sum)
                     HWY_ATTR { tiles.template add_products<sum, 4 + sum / 2, 6 + sum % 2>(); });
  }
  for_each_sum([&](auto sum) HWY_ATTR {
    constexpr int kAt = sum % 2 * kRowTiles + sum / 2;
    tiles.template store<sum>(sums + kAt * kTileRows * kLanes);
  });
}

/// Calls `sink(output block, first column, sums)` for at most two blocks and two tiles of columns.
template <class Sink>
void multiply_in_tiles(const TileFactors& f, int64_t blocks, int64_t columns, Tiles& tiles,
                       const Sink& sink) {
  alignas(64) float sums[4 * kTileRows * kLanes];
  const bool two_blocks = blocks > 1, two_tiles = columns > kTileRows;
  const auto sum = two_blocks  ? two_tiles ? sum_tiles<2, 2> : sum_tiles<1, 2>
                    : two_tiles ? sum_tiles<2, 1>
                               : sum_tiles<1, 1>;
  sum(f, tiles, sums);
  constexpr int kTogether = 4;
  const auto take = [&]<int kCount>(int64_t block, int64_t column) HWY_ATTR {
    const float* const from = sums + ((block << two_tiles) * kTileRows + column) * kLanes;
    Block taken[kCount];
    REVISIT_UNROLL
    for (int i = 0; i < kCount; ++i) taken[i] = load_block(from + i * kLanes);
    sink(block, column, taken);
  };
  for (int64_t block = 0; block < blocks; ++block) {
    int64_t column = 0;
    for (; column + kTogether <= columns; column += kTogether)
      take.template operator()<kTogether>(block, column);
    for (; column < columns; ++column) take.template operator()<1>(block, column);
  }
}

}  // namespace revisit::engine::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#endif
