#include "releasable_weights.h"

#include "layout.h"

namespace revisit::engine {

void ReleasableWeights::add(size_t layer, std::vector<Tensor> weights) {
  auto kept = std::make_shared<const std::vector<Tensor>>(std::move(weights));
  entries_[layer] = {kept, kept};
}

ReleasableWeights::Blobs ReleasableWeights::get(size_t layer) {
  const std::lock_guard lock(mutex_);
  Entry& entry = entries_.at(layer);
  Blobs weights = entry.weights.lock();
  if (!weights) {
    weights = std::make_shared<const std::vector<Tensor>>(read_(layer));
    entry.weights = weights;
  }
  return weights;
}

void ReleasableWeights::release(size_t layer) {
  const std::lock_guard lock(mutex_);
  entries_.at(layer).kept.reset();
}

int64_t ReleasableWeights::bytes_in_memory() const {
  const std::lock_guard lock(mutex_);
  int64_t bytes = 0;
  for (const auto& [layer, entry] : entries_)
    if (const auto weights = entry.weights.lock())
      for (const Tensor& weight : *weights) bytes += floats(weight.shape.elements()).count;
  return bytes;
}

}  // namespace revisit::engine
