#pragma once

#include <string>
#include <vector>

#include "kernels/convolution.h"
#include "kernels/nchw.h"

/// Problems of the files in tests/problems/.
namespace revisit::test {

template <class Problem>
struct Named {
  std::string name;
  Problem problem;
};

using NamedConvolution = Named<engine::ConvolutionProblem>;
enum class MapSize { kSmall, kFull };  // for tests; as in the network
std::vector<NamedConvolution> convolution_problems(MapSize size = MapSize::kSmall);

engine::ConvolutionNdProblem over_axes(const engine::ConvolutionProblem& p);

struct BlockedPooling {
  int64_t n, c;
  engine::PoolingProblem window;
};
std::vector<Named<BlockedPooling>> pooling_problems();

std::vector<Named<engine::LrnProblem>> lrn_problems();

std::vector<Named<engine::InnerProductProblem>> inner_product_problems();

/// Replaces characters that GoogleTest rejects in names.
template <class Problem>
std::string test_name(const Named<Problem>& named) {
  std::string name = named.name;
  for (char& c : name)
    if (!std::isalnum(static_cast<unsigned char>(c))) c = '_';
  return name;
}

}  // namespace revisit::test
