#include <cmath>
#include <map>

#include "load_weights.h"

namespace revisit::engine {
namespace {

/// splitmix64 (Steele, Lea, Flood 2014): the same numbers on every platform.
uint64_t next_random(uint64_t& state) {
  uint64_t z = state += 0x9E3779B97F4A7C15ULL;
  z = (z ^ (z >> 30)) * 0xBF58476D1CE4E5B9ULL;
  z = (z ^ (z >> 27)) * 0x94D049BB133111EBULL;
  return z ^ (z >> 31);
}

/// Whether values of a weight blob have to be around 1: variances of BatchNorm (blob 1; blob 2
/// divides both sums), factors of Scale and Normalize, factors and variances of BN.
bool is_around_one(const std::string& type, size_t blob) {
  return (type == "BatchNorm" && blob > 0) || (type == "BN" && (blob == 0 || blob == 3)) ||
         ((type == "Scale" || type == "Normalize") && blob == 0);
}

}  // namespace

void fill_randomly(Net::Impl& net, uint64_t seed) {
  uint64_t state = seed;
  std::map<std::string, const Tensor*> first_of;  // of each group that shares a parameter
  for (Node& node : net.graph.nodes) {
    const std::string& type = node.param.type();
    for (size_t blob = 0; blob < node.weights.size(); ++blob) {
      Tensor& weight = node.weights[blob];
      const auto group = net.sharing.find({node.name, blob});
      if (group != net.sharing.end()) {
        const auto [first, is_new] = first_of.try_emplace(group->second, &weight);
        if (!is_new) {
          weight.values = first->second->values;
          continue;
        }
      }
      const bool is_summed = weight.shape.rank() > 1 && type != "BN";
      const int64_t fan_in = is_summed ? weight.shape.product(1, weight.shape.rank()) : 1;
      const double limit = is_summed ? std::sqrt(6.0 / static_cast<double>(fan_in)) : 0.1;
      const double centre = is_around_one(type, blob) ? 1 : 0;
      weight.values.resize(weight.shape.elements());
      for (float& value : weight.values) {
        const double unit = static_cast<double>(next_random(state) >> 11) * 0x1.0p-53;  // [0, 1)
        value = static_cast<float>(centre + limit * (2 * unit - 1));
      }
    }
  }
  net.has_weights = true;
}

}  // namespace revisit::engine
