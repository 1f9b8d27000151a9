#include "kernels/busy_loops.h"

#include "kernels/blocked/dispatch.h"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "kernels/blocked/busy_loops.cpp"
#include <hwy/foreach_target.h>
// After foreach_target.h.
#include "kernels/blocked/tiles-inl.h"

HWY_BEFORE_NAMESPACE();
namespace revisit::engine::HWY_NAMESPACE {
namespace {

constexpr int kSums = 12;  // more than latency times throughput

LoopWork multiply_bf16_here(int64_t rounds) {
  volatile float one = 1;
  const Vector input = hn::Set(Tag(), one);
  Block weights, sums[kSums];
  REVISIT_UNROLL
  for (int i = 0; i < kVectors; ++i) weights.v[i] = input;
  REVISIT_UNROLL
  for (int i = 0; i < kSums; ++i) sums[i] = zero_block();
  for (int64_t round = 0; round < rounds; ++round) {
    REVISIT_UNROLL
    for (int i = 0; i < kSums; ++i) sums[i] = add_products(BFloat16(), input, weights, sums[i]);
  }
  REVISIT_UNROLL
  for (int i = 1; i < kSums; ++i) sums[0] = sums[0] + sums[i];
  return {2 * rounds * kSums * kLanes * kStep<BFloat16>, hn::GetLane(sums[0].v[0])};
}

LoopWork multiply_tiles_here(int64_t rounds) {
  alignas(64) const BFloat16 numbers[kTileNumbers] = {};
  alignas(64) float sums[kTileRows * kLanes];
  Tiles tiles;
  tiles.zero<0>();
  tiles.zero<1>();
  tiles.zero<2>();
  tiles.zero<3>();
  tiles.load<4>(numbers, kTileDepth);
  tiles.load<5>(numbers, kTileDepth);
  tiles.load<6>(numbers, kTileDepth);
  tiles.load<7>(numbers, kTileDepth);
  for (int64_t round = 0; round < rounds; ++round) {
    tiles.add_products<0, 4, 6>();
    tiles.add_products<1, 4, 7>();
    tiles.add_products<2, 5, 6>();
    tiles.add_products<3, 5, 7>();
  }
  tiles.store<3>(sums);
  return {2 * rounds * 4 * kTileRows * kLanes * kTileDepth, sums[0]};
}

}  // namespace
}  // namespace revisit::engine::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace revisit::engine {

HWY_EXPORT(multiply_bf16_here);
HWY_EXPORT(multiply_tiles_here);

LoopWork multiply_bf16(int64_t rounds) {
  return REVISIT_DISPATCH(multiply_bf16_here, Instructions::kBf16)(rounds);
}

LoopWork multiply_bf16_tiles(int64_t rounds) {
  return REVISIT_DISPATCH(multiply_tiles_here, Instructions::kTiles)(rounds);
}

}  // namespace revisit::engine
#endif
