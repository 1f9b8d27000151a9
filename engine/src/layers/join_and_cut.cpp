#include "layers/join_and_cut.h"

#include <algorithm>
#include <numeric>

namespace revisit::engine {

Kernel copy_kernel(const char* name, StridedCopyProblem copy) {
  return {name, [copy = std::move(copy)](const Call& call) {
            strided_copy(copy, call.inputs[0], call.outputs[0]);
          }};
}

Kernel join_kernel(int64_t outer, const std::vector<int64_t>& sizes) {
  Kernel kernel{"copy", [outer, sizes](const Call& call) {
                  float* out = call.outputs[0];
                  for (int64_t i = 0; i < outer; ++i)
                    for (size_t input = 0; input < sizes.size(); ++input)
                      out = std::copy_n(call.inputs[input] + i * sizes[input], sizes[input], out);
                }};
  if (outer == 1) kernel.aliasing = Aliasing::kJoinsInputs;
  return kernel;
}

Kernel cut_kernel(int64_t outer, const std::vector<int64_t>& sizes, int threads) {
  const int64_t whole = std::accumulate(sizes.begin(), sizes.end(), int64_t{0});
  std::vector<StridedCopyProblem> copies;
  int64_t offset = 0;
  for (const int64_t size : sizes) {
    copies.push_back({{outer, size}, {whole, 1}, offset, threads});
    offset += size;
  }
  Kernel kernel{"copy", [copies = std::move(copies)](const Call& call) {
                  for (size_t i = 0; i < copies.size(); ++i)
                    if (call.outputs[i] != call.inputs[0] + copies[i].offset)
                      strided_copy(copies[i], call.inputs[0], call.outputs[i]);
                }};
  if (outer == 1) kernel.aliasing = Aliasing::kCutsInput;
  return kernel;
}

}  // namespace revisit::engine
