#include "kernels/convolution.h"

namespace revisit::engine {

std::span<const ConvolutionKernel> convolution_kernels() {
  static const ConvolutionKernel kList[] = {kConvolutionPointwiseGemm, kConvolutionIm2colGemm,
                                            kConvolutionReference};
  return kList;
}

}  // namespace revisit::engine
