#pragma once

#include <cstdint>
#include <functional>
#include <map>
#include <memory>
#include <mutex>
#include <string>

#include "aligned.h"

namespace revisit::engine {

/// Weights of one layer in the order of one kernel.
struct PackedWeights {
  AlignedFloats weights, bias;
  AlignedFloats outside = {};  // BlockedConvolutionArguments::outside
  int64_t floats() const { return weights.size() + bias.size() + outside.size(); }
};

/// The packed weights of a net, shared by all its plans and gone when no plan needs them. Safe to
/// use from several threads.
class WeightCache {
 public:
  using Pack = std::function<PackedWeights()>;

  /// What is stored under `key`, or what `pack` makes. A key must mean the same forever.
  std::shared_ptr<const PackedWeights> get(const std::string& key, const Pack& pack);

  /// Of all that is in use [floats].
  int64_t floats_in_use() const;

 private:
  mutable std::mutex mutex_;
  std::map<std::string, std::weak_ptr<const PackedWeights>> entries_;
};

}  // namespace revisit::engine
