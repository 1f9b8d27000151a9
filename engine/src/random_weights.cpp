#include <cmath>
#include <map>

#include "load_weights.h"
#include "revisit/base/hash.h"

namespace revisit::engine {
namespace {

/// Returns whether values of a weight blob must be around 1: variances of BatchNorm (blob 1; blob 2
/// divides both sums), factors of Scale and Normalize, factors and variances of BN.
bool is_around_one(const std::string& type, size_t blob) {
  return (type == "BatchNorm" && blob > 0) || (type == "BN" && (blob == 0 || blob == 3)) ||
         ((type == "Scale" || type == "Normalize") && blob == 0);
}

}  // namespace

void fill_randomly(Net::Impl& net, uint64_t seed) {
  uint64_t n_drawn = 0;
  std::map<std::string, const Tensor*> first_blob_of_group;
  for (Node& node : net.graph.nodes) {
    const std::string& type = node.param.type();
    for (size_t blob = 0; blob < node.weights->size(); ++blob) {
      Tensor& weight = (*node.weights)[blob];
      if (const std::string group = parameter_of(node, blob); !group.empty()) {
        const auto [first, is_new] = first_blob_of_group.try_emplace(group, &weight);
        if (!is_new) {
          weight.values = first->second->values;
          continue;
        }
      }
      const bool is_summed = weight.shape.rank() > 1 && type != "BN";
      const int64_t fan_in = is_summed ? weight.shape.product(1, weight.shape.rank()) : 1;
      const double limit = is_summed ? std::sqrt(6.0 / static_cast<double>(fan_in)) : 0.1;
      const double center = is_around_one(type, blob) ? 1 : 0;
      weight.values.resize(weight.shape.elements());
      for (float& value : weight.values)
        value = static_cast<float>(center + limit * (2 * unit_number(seed, n_drawn++) - 1));
    }
  }
  net.has_weights = true;
}

}  // namespace revisit::engine
