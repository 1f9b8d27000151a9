// Matrix product of all NCHWc convolutions: a panel of columns (pixels or tiles) times blocks of
// output channels. Included once per target.
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
#include "kernels/blocked/column_panels.h"

HWY_BEFORE_NAMESPACE();
namespace revisit::engine::HWY_NAMESPACE {

constexpr int kTileBlocks = sum_tile(kRegisters, kVectors).blocks;
constexpr int kTileColumns = sum_tile(kRegisters, kVectors).columns;

/// Input channels per multiplication: one float32, or two bfloat16 in 4 bytes. Strides count
/// numbers of type T; weights of `kStep` channels are [kLanes][kStep].
template <class T>
constexpr int64_t kStep = std::is_same_v<T, float> ? 1 : 2;

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
  const T* prefetched;   // to prefetch, as much as one output block's weights
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
};

/// Calls `sink(output block, first column, sums)` block by block. The sink may modify the sums.
template <int kBlocks, int kColumns, class T, class Sink>
void multiply_tile(const Factors<T>& f, int64_t first_block, int64_t first_column,
                   const Sink& sink) {
  Block sums[kBlocks][kColumns];
  REVISIT_UNROLL
  for (int b = 0; b < kBlocks; ++b) {
    REVISIT_UNROLL
    for (int c = 0; c < kColumns; ++c) sums[b][c] = zero_block();
  }
  constexpr int64_t kWeights = kLanes * kStep<T>;
  const T* HWY_RESTRICT weights = f.weights;
  const T* HWY_RESTRICT inputs = f.inputs;
  const T* prefetched = f.prefetched;
  for (int64_t block = 0; block < f.in_blocks; ++block, inputs += f.inputs_step) {
    for (int64_t channel = 0; channel < kLanes;
         channel += kStep<T>, weights += kWeights, prefetched += kWeights) {
      hwy::Prefetch(prefetched);
      hwy::Prefetch(inputs + f.inputs_step + std::min<int64_t>(channel, kColumns - 1) * kLanes);
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

/// Like multiply_tile(), for `blocks` output blocks and up to kMaxColumns columns.
template <class T, class Sink>
void multiply(const Factors<T>& f, int64_t blocks, int64_t columns, const Sink& sink) {
  const int64_t parts = (columns + kTileColumns - 1) / kTileColumns;
  const int64_t width = parts == 1 ? columns : (columns + parts - 1) / parts;
  for (int64_t b = 0; b < blocks; b += kTileBlocks) {
    for (int64_t first = 0; first < columns; first += width) {
      const int64_t count = std::min(width, columns - first);
      Factors<T> here = f;
      here.weights += b * f.weights_step;
      here.inputs += first * kLanes;
      constexpr auto kColumns = std::make_index_sequence<kTileColumns>();
      if (kTileBlocks > 1 && blocks - b > 1)
        multiply_columns<kTileBlocks>(here, count, b, first, sink, kColumns);
      else
        multiply_columns<1>(here, count, b, first, sink, kColumns);
    }
  }
}

}  // namespace revisit::engine::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#endif
