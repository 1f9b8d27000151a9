#include "kernels/blocked/cost_model.h"

#include "kernels/blocked/direct_shape.h"

namespace revisit::engine {
namespace {

constexpr double kMacsPerMs = 1e8;

}

double plain_input_ms(const ConvolutionProblem& p) {
  return static_cast<double>(p.n * padded_channels(p.c_out) * p.out_pixels() * p.depth()) /
         kMacsPerMs;
}

double depthwise_ms(const ConvolutionProblem& p) {
  return 4 * static_cast<double>(p.macs()) / kMacsPerMs;
}

double pointwise_ms(const ConvolutionProblem& p) {
  return 0.9 * direct_ms(p);
}

double direct_ms(const ConvolutionProblem& p) {
  const DirectShape s(p);
  return static_cast<double>(s.images * s.strips.count * s.out_blocks * s.weights_floats()) /
         kMacsPerMs;
}

double winograd_ms(const WinogradVariant& v, const ConvolutionProblem& p) {
  const WinogradShape s(v, p);
  const auto tiles = static_cast<double>(s.points * s.strips.count);
  return tiles *
         static_cast<double>(s.in_blocks_per_group() * s.out_blocks * kLanes * kLanes +
                             100 * (s.in_blocks + s.out_blocks)) /
         kMacsPerMs;
}

}  // namespace revisit::engine
