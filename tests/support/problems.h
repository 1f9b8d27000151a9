#pragma once

#include <string>
#include <vector>

#include "kernels/convolution.h"
#include "kernels/convolution_nd.h"
#include "kernels/inner_product.h"
#include "kernels/lrn.h"
#include "kernels/pooling.h"

/// The lines of tests/problems/.
namespace revisit::test {

template <class Problem>
struct Named {
  std::string name;
  Problem problem;
};

using NamedConvolution = Named<engine::ConvolutionProblem>;
enum class MapSize { kSmall, kFull };  // for tests; as in the network
std::vector<NamedConvolution> convolution_problems(MapSize size = MapSize::kSmall);

/// As the kernels on plain values take it.
engine::ConvolutionNdProblem over_axes(const engine::ConvolutionProblem& p);

struct BlockedPooling {
  int64_t n, c;
  engine::PoolingProblem window;
};
std::vector<Named<BlockedPooling>> pooling_problems();

std::vector<Named<engine::LrnProblem>> lrn_problems();

std::vector<Named<engine::InnerProductProblem>> inner_product_problems();

/// The name with what GoogleTest allows in names of tests.
template <class Problem>
std::string test_name(const Named<Problem>& named) {
  std::string name = named.name;
  for (char& c : name)
    if (!std::isalnum(static_cast<unsigned char>(c))) c = '_';
  return name;
}

}  // namespace revisit::test
