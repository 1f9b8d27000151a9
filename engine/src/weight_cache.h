#pragma once

#include <sys/types.h>

#include <compare>
#include <cstdint>
#include <functional>
#include <map>
#include <memory>
#include <mutex>
#include <string>
#include <vector>

#include "aligned.h"
#include "layout.h"

namespace revisit::engine {

/// Weights of one layer in the order of one kernel.
struct PackedWeights {
  AlignedFloats weights, bias;
  AlignedFloats outside_taps = {};  // BlockedConvolutionArguments::outside_taps
  int64_t bytes() const { return floats(weights.size() + bias.size() + outside_taps.size()).count; }
};

/// All that decides what is packed; the weights of a net's layers never change.
struct PackedWeightsKey {
  size_t layer;                        // index into Graph::nodes
  std::vector<size_t> affine_layers;   // Fusion::affine_layers
  std::vector<uint32_t> gray_offsets;  // Fusion::gray_offsets, their bits
  bool has_constants;                  // FusedConvolution::has_constants()
  std::string kernel;                  // that wants this order
  Precision values;                    // ConvolutionProblem::values
  // NOLINTNEXTLINE(modernize-use-nullptr): clang-tidy 14 takes the comparison with 0 for a pointer
  friend auto operator<=>(const PackedWeightsKey&, const PackedWeightsKey&) = default;
};

/// The packed weights of a net, shared by all its plans until no plan needs them. Thread-safe.
class WeightCache {
 public:
  using Pack = std::function<PackedWeights()>;

  /// What is stored under `key`, or what `pack` makes.
  std::shared_ptr<const PackedWeights> get(const PackedWeightsKey& key, const Pack& pack);

  /// Of all that is in use.
  int64_t bytes_in_use() const;

 private:
  /// A mutex that threads of this process hold while they pack: after fork() one of the parent's
  /// may hold its own for ever.
  std::shared_ptr<std::mutex> packing_of_process();
  std::shared_ptr<const PackedWeights> find(const PackedWeightsKey& key) const;

  // All guarded by process_lock().
  pid_t process_ = 0;
  std::shared_ptr<std::mutex> packing_;
  std::map<PackedWeightsKey, std::weak_ptr<const PackedWeights>> entries_;
};

}  // namespace revisit::engine
