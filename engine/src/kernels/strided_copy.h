#pragma once

#include <cstdint>
#include <vector>

namespace revisit::engine {

/// output[i][j][k]... = input[offset + i * strides[0] + j * strides[1] + ...], the form of all
/// slices, crops, tiles, transposes and shuffles.
struct StridedCopyProblem {
  std::vector<int64_t> shape;    // of the output, at least one axis
  std::vector<int64_t> strides;  // in the input, one per axis of the output
  int64_t offset = 0;
  int threads = 1;
};

void strided_copy(const StridedCopyProblem& problem, const float* input, float* output);

}  // namespace revisit::engine
