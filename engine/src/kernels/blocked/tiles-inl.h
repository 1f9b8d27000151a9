// Multiplies bfloat16 in AMX tiles, or emulates them. Included once per target.
#if defined(REVISIT_TILES_INL_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef REVISIT_TILES_INL_H_
#undef REVISIT_TILES_INL_H_
#else
#define REVISIT_TILES_INL_H_
#endif

#include "kernels/blocked/multiply-inl.h"
#include "kernels/blocked/tile_shape.h"

HWY_BEFORE_NAMESPACE();
namespace revisit::engine::HWY_NAMESPACE {

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
