#include "kernels/blocked/convolution.h"

#include <vector>

#include "kernels/blocked/convolution_list.h"
#include "kernels/blocked/dispatch.h"

namespace revisit::engine {

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
