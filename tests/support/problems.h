#pragma once

#include <string>
#include <vector>

#include "kernels/convolution.h"

namespace revisit::test {

struct NamedConvolution {
  std::string name;
  engine::ConvolutionProblem problem;
};

/// The lines of tests/problems/convolution.txt.
std::vector<NamedConvolution> convolution_problems();

}  // namespace revisit::test
