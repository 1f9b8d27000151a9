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

#include "layer.h"

namespace revisit::engine {

/// Everything that determines packed weights; the weights of a net's layers are constant.
struct PackedWeightsKey {
  size_t layer;                           // index into Graph::nodes
  std::vector<size_t> affine_layers;      // Fusion::affine_layers
  std::vector<uint32_t> channel_offsets;  // bits of Fusion::channel_offsets
  bool has_constants;                     // FusedConvolution::has_constants()
  std::string kernel;                     // defines the order
  Precision values;                       // ConvolutionProblem::values
  // NOLINTNEXTLINE(modernize-use-nullptr): clang-tidy 14 takes the comparison with 0 for a pointer
  friend auto operator<=>(const PackedWeightsKey&, const PackedWeightsKey&) = default;
};

/// Packed weights of a net, shared by its plans while any plan uses them. Thread-safe.
class WeightCache {
 public:
  using Pack = std::function<PackedWeights()>;

  std::shared_ptr<const PackedWeights> get(const PackedWeightsKey& key, const Pack& pack);

  int64_t bytes_in_use() const;

 private:
  /// Mutex for packing, recreated after fork(), because a thread of the parent may have held it.
  std::shared_ptr<std::mutex> packing_of_process();
  std::shared_ptr<const PackedWeights> find(const PackedWeightsKey& key) const;

  // All guarded by process_lock().
  pid_t process_ = 0;
  std::shared_ptr<std::mutex> packing_;
  std::map<PackedWeightsKey, std::weak_ptr<const PackedWeights>> entries_;
};

}  // namespace revisit::engine
