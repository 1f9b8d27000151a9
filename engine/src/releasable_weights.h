#pragma once

#include <cstdint>
#include <functional>
#include <map>
#include <memory>
#include <mutex>
#include <vector>

#include "revisit/engine/tensor.h"

namespace revisit::engine {

/// Weights of layers as the file has them, for layers whose kernels may pack them and then no
/// longer need them. Safe to use from several threads.
class ReleasableWeights {
 public:
  using Blobs = std::shared_ptr<const std::vector<Tensor>>;
  using Read = std::function<std::vector<Tensor>(size_t layer)>;

  /// How weights that were released are read again.
  void read_with(Read read) { read_ = std::move(read); }
  void add(size_t layer, std::vector<Tensor> weights);

  bool has(size_t layer) const { return entries_.contains(layer); }
  /// The weights of a layer that it has; read again where they are no longer in memory.
  Blobs get(size_t layer);
  /// From now on they stay in memory as long as somebody holds them.
  void release(size_t layer);
  /// Of all that is in memory [floats].
  int64_t bytes_in_memory() const;

 private:
  struct Entry {
    Blobs kept;  // until they are released
    std::weak_ptr<const std::vector<Tensor>> weights;
  };
  Read read_;
  mutable std::mutex mutex_;
  std::map<size_t, Entry> entries_;  // by layer; none is added after loading
};

}  // namespace revisit::engine
