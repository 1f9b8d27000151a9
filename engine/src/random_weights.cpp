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

/// Random numbers of one blob: number i does not depend on earlier calls.
class WeightNumbers {
 public:
  WeightNumbers(uint64_t seed, uint64_t layer, uint64_t blob)
      : key_(mixed_bits(mixed_bits(seed + kSplitmixStep) + layer * kSplitmixStep + blob)) {}

  /// Gaussian of variance 1 (mean 12 * (2^32 - 1) / 2, units of 2^32); exact in double.
  double gaussian(uint64_t i) const {
    int64_t sum = 0;
    for (uint64_t j = 0; j < 6; ++j) {
      const uint64_t bits = word(6 * i + j);
      sum += static_cast<int64_t>(bits >> 32) + static_cast<int64_t>(bits & 0xFFFFFFFF);
    }
    constexpr int64_t kMean = 6 * ((int64_t{1} << 32) - 1);
    return std::ldexp(static_cast<double>(sum - kMean), -32);
  }

  /// Uniform in [-1, 1); exact in double.
  double uniform(uint64_t i) const {
    return std::ldexp(static_cast<double>(word(i) >> 12), -51) - 1;
  }

 private:
  uint64_t word(uint64_t i) const { return mixed_bits(key_ + (i + 1) * kSplitmixStep); }

  uint64_t key_;
};

void fill_blob(const std::string& type, size_t blob, const WeightNumbers& numbers, Tensor& weight) {
  weight.values.resize(weight.shape.elements());
  const size_t rank = weight.shape.rank();
  const bool is_summed = rank > 1 && type != "BN";
  const double fan_in = is_summed ? static_cast<double>(weight.shape.product(1, rank)) : 1;
  const double sigma = std::sqrt(2 / fan_in);
  const bool around_one = is_around_one(type, blob);
  uint64_t i = 0;
  for (float& value : weight.values) {
    const double number = is_summed    ? sigma * numbers.gaussian(i)
                          : around_one ? 1 + 0.1 * numbers.uniform(i)
                                       : 0.01 * numbers.uniform(i);
    value = static_cast<float>(number);
    ++i;
  }
}

}  // namespace

void fill_randomly(Net::Impl& net, uint64_t seed) {
  std::map<std::string, const Tensor*> first_blob_of_group;
  for (Node& node : net.graph.nodes) {
    for (size_t blob = 0; blob < node.weights->size(); ++blob) {
      Tensor& weight = (*node.weights)[blob];
      if (const std::string group = parameter_of(node, blob); !group.empty()) {
        const auto [first, is_new] = first_blob_of_group.try_emplace(group, &weight);
        if (!is_new) {
          weight.values = first->second->values;
          continue;
        }
      }
      fill_blob(node.param.type(), blob, {seed, static_cast<uint64_t>(node.index), blob}, weight);
    }
  }
  net.has_weights = true;
}

}  // namespace revisit::engine
