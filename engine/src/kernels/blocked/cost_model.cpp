#include "kernels/blocked/cost_model.h"

namespace revisit::engine {

double winograd_ms(const WinogradVariant& v, const ConvolutionProblem& p) {
  const WinogradShape shape(v, p);
  return 1e-7 *
         static_cast<double>(shape.points * shape.strips.count * p.c_in_per_group() * p.c_out);
}

}  // namespace revisit::engine
