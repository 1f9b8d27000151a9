#include "problems.h"

#include <gtest/gtest.h>

#include <fstream>
#include <sstream>

namespace revisit::test {

std::vector<NamedConvolution> convolution_problems() {
  std::ifstream file(REVISIT_PROBLEMS "/convolution.txt");
  std::vector<NamedConvolution> problems;
  for (std::string line; std::getline(file, line);) {
    if (line.empty() || line[0] == '#') continue;
    std::istringstream fields(line);
    NamedConvolution c;
    engine::ConvolutionProblem& p = c.problem;
    fields >> c.name >> p.n >> p.c_in >> p.h >> p.w >> p.c_out >> p.kernel_h >> p.kernel_w >>
        p.stride_h >> p.stride_w >> p.pad_h >> p.pad_w >> p.dilation_h >> p.dilation_w >> p.group;
    if (!fields) ADD_FAILURE() << "malformed problem: " << line;
    p.out_h = (p.h + 2 * p.pad_h - p.dilation_h * (p.kernel_h - 1) - 1) / p.stride_h + 1;
    p.out_w = (p.w + 2 * p.pad_w - p.dilation_w * (p.kernel_w - 1) - 1) / p.stride_w + 1;
    problems.push_back(std::move(c));
  }
  if (problems.empty()) ADD_FAILURE() << "no convolution problems found";
  return problems;
}

}  // namespace revisit::test
