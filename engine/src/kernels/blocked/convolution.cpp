#include <algorithm>
#include <vector>

#include "kernels/blocked/kernels.h"
#include "kernels/blocked/partition.h"
#include "revisit/engine/machine.h"

namespace revisit::engine {
namespace {

constexpr double kCyclesPerMs = 3.4e6;

/// Cycles of multiply-adds for `depth` input channels, all panels of columns and all output blocks.
/// A channel takes two blocks times the columns of a panel at two multiply-adds per cycle; fewer
/// than kLatency cannot hide the latency.
double multiply_cycles(int64_t columns, double depth, int64_t out_blocks) {
  constexpr double kLatency = 8, kPerCycle = 2, kPerTile = 60, kLoads = 0.03;
  const auto panels = static_cast<double>(panels_of(columns).parts);
  const double width = static_cast<double>(columns) / panels;
  const auto tile = [&](double blocks) {
    return depth * std::max(blocks * width, kLatency) / kPerCycle * (1 + kLoads) + kPerTile;
  };
  const int64_t pairs = out_blocks / 2, odd = out_blocks % 2;
  return panels * (static_cast<double>(pairs) * tile(2) + static_cast<double>(odd) * tile(1));
}

/// Stall cycles for weights that each chunk reads once from the L3 cache or memory; part of the
/// reading overlaps with multiplications.
double weights_cycles(double bytes, int64_t chunks, double multiply) {
  constexpr double kL2 = 1.2e6, kL3 = 16e6;                  // bytes of weights it keeps
  constexpr double kL3PerCycle = 14, kMemoryPerCycle = 8.8;  // bytes
  constexpr double kHidden = 0.4, kSlowed = 0.05;
  if (bytes < kL2) return 0;
  const double read =
      bytes * static_cast<double>(chunks) / (bytes < kL3 ? kL3PerCycle : kMemoryPerCycle);
  return std::max(read - kHidden * multiply, 0.0) + kSlowed * read;
}

/// Relative to float32: bfloat16 are multiplied in pairs, or converted first.
double channel_cost(Precision values) {
  if (values == Precision::kFloat32) return 1;
  if (!has_bf16_instructions()) return 2;
  // On CPUs with tiles, the other instruction is slow: on Sapphire Rapids 58 against 115 in float32
  // (docs/reference/SPEED.md).
  return has_bf16_tiles() ? 2 : 0.5;
}

/// Cycles of products in tiles, for `steps` steps of kTileDepth channels.
double tile_cycles(int64_t columns, double steps, int64_t out_blocks) {
  // kPerProduct, for 16 x 32 x 16 numbers, is an estimate, because no layer was measured on a CPU
  // with tiles. It assumes bare products from L2, at half their speed from registers.
  constexpr double kPerProduct = 46, kPerStoredBlock = 4;
  const auto tiles = static_cast<double>(Split{columns, 1, kTileRows}.units());
  return static_cast<double>(out_blocks) *
         (tiles * steps * kPerProduct + static_cast<double>(columns) * kPerStoredBlock);
}

/// Without the instructions, tiles are emulated, for tests only.
double tile_slowness() {
  constexpr double kEmulated = 1000;
  return has_bf16_tiles() ? 1 : kEmulated;
}

double unfold_cycles(const ConvolutionProblem& p, const DirectShape& s) {
  constexpr double kPerBlock = 1.8, kPerRun = 12;  // per tap
  return static_cast<double>(s.images * s.depth()) *
         (kPerBlock * static_cast<double>(p.out_pixels()) +
          kPerRun * static_cast<double>(panels_of(p.out_pixels(), s.panel).parts));
}

/// The choice of a kernel must not depend on the number of threads, so that results do not either.
ConvolutionProblem on_one_thread(ConvolutionProblem p) {
  p.threads = 1;
  return p;
}

}  // namespace

double plain_input_ms(const ConvolutionProblem& p) {
  const auto rows = static_cast<double>(p.n * p.out_h);
  return rows *
         multiply_cycles(p.out_w, channel_cost(p.values) * static_cast<double>(p.depth()),
                         channel_blocks(p.c_out)) /
         kCyclesPerMs;
}

double depthwise_ms(const ConvolutionProblem& p) {
  // Every multiply-add loads its input.
  constexpr double kPerTap = 1.3, kPerBlock = 10;
  const auto blocks = static_cast<double>(p.n * channel_blocks(p.c_out) * p.out_pixels());
  return blocks * (kPerTap * static_cast<double>(p.kernel_h * p.kernel_w) + kPerBlock) /
         kCyclesPerMs;
}

double pointwise_ms(const ConvolutionProblem& problem) {
  const ConvolutionProblem p = on_one_thread(problem);
  const DirectShape s(p);
  const double multiply =
      static_cast<double>(s.images) *
      multiply_cycles(p.out_pixels(),
                      channel_cost(p.values) * static_cast<double>(s.depth() * kLanes),
                      s.out_blocks);
  const int64_t bytes = s.out_blocks * s.weights() * value_bytes(p.values);
  return (multiply +
          weights_cycles(static_cast<double>(bytes), s.images * s.chunks.columns.parts, multiply)) /
         kCyclesPerMs;
}

double direct_ms(const ConvolutionProblem& p) {
  return pointwise_ms(p) + unfold_cycles(p, DirectShape(p)) / kCyclesPerMs;
}

double plain_input_tiles_ms(const ConvolutionProblem& p) {
  constexpr double kPerRun = 8;  // per unfolded row of kernel taps
  const auto rows = static_cast<double>(p.n * p.out_h), columns = static_cast<double>(p.out_w);
  const int64_t steps = plain_input_weights(p) / (kTileDepth * kLanes);
  const double unfold = columns * static_cast<double>(p.c_in * p.kernel_h) * kPerRun;
  const double tiles = tile_cycles(p.out_w, static_cast<double>(steps), channel_blocks(p.c_out));
  return rows * (unfold + tiles) * tile_slowness() / kCyclesPerMs;
}

double tiles_ms(const ConvolutionProblem& problem) {
  const ConvolutionProblem p = on_one_thread(problem);
  const DirectShape s(p, kTileCut);
  const int64_t steps = s.packed_depth * kLanes / kTileDepth;
  const double multiply = static_cast<double>(s.images) *
                          tile_cycles(p.out_pixels(), static_cast<double>(steps), s.out_blocks);
  const auto bytes = static_cast<double>(s.out_blocks * s.weights() * value_bytes(p.values));
  const double cycles = multiply + unfold_cycles(p, s) +
                        weights_cycles(bytes, s.images * s.chunks.columns.parts, multiply);
  return cycles * tile_slowness() / kCyclesPerMs;
}

double winograd_ms(const WinogradVariant& v, const ConvolutionProblem& problem) {
  constexpr double kInputPoint = 8, kOutputPoint = 7;  // per block of a tile
  const ConvolutionProblem p = on_one_thread(problem);
  const WinogradShape s(v, p);
  const auto points = static_cast<double>(s.points);
  const double transforms = points * static_cast<double>(s.tiles()) *
                            (kInputPoint * static_cast<double>(s.in_blocks) +
                             kOutputPoint * static_cast<double>(s.out_blocks));
  const int64_t depth = s.in_blocks_per_group() * kLanes;
  const double multiply =
      points * static_cast<double>(s.group) *
      multiply_cycles(s.tiles(), static_cast<double>(depth), s.out_blocks_per_group());
  const double weights = points * static_cast<double>(floats(depth * s.out_blocks * kLanes).count);
  return (transforms + multiply + weights_cycles(weights, s.chunks.columns.parts, multiply)) /
         kCyclesPerMs;
}

std::span<const BlockedConvolutionKernel> blocked_convolution_kernels() {
  static const std::vector<BlockedConvolutionKernel> kList = [] {
    std::vector<BlockedConvolutionKernel> list = {
        kBlockedPlainInput, kBlockedPlainInputTiles, kBlockedDepthwise, kBlockedNarrowGroups,
        kBlockedPointwise,  kBlockedDirect,          kBlockedTiles};
    const auto winograd = winograd_kernels();
    list.insert(list.end(), winograd.begin(), winograd.end());
    return list;
  }();
  return kList;
}

const BlockedConvolutionKernel* choose_blocked_convolution(const ConvolutionProblem& p,
                                                           Layout input, int most_points) {
  if (!has_blocked_kernels()) return nullptr;
  const BlockedConvolutionKernel* best = nullptr;
  double best_ms = 0;
  for (const BlockedConvolutionKernel& kernel : blocked_convolution_kernels()) {
    if (kernel.input != input || kernel.transform_points > most_points || !kernel.supports(p))
      continue;
    const double ms = kernel.predicted_ms(p);
    if (best && best_ms <= ms) continue;
    best = &kernel;
    best_ms = ms;
  }
  return best;
}

}  // namespace revisit::engine
