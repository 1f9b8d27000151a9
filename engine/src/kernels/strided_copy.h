#pragma once

#include <cstdint>
#include <vector>

namespace revisit::engine {

/// output[i][j][k]... = input[offset + i * strides[0] + j * strides[1] + ...].
struct StridedCopyProblem {
  std::vector<int64_t> shape;    // output shape, at least one axis
  std::vector<int64_t> strides;  // input strides, one per axis of the output
  int64_t offset = 0;
  int threads = 1;
};

void strided_copy(const StridedCopyProblem& problem, const float* input, float* output);

}  // namespace revisit::engine
