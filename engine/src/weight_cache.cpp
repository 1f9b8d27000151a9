#include "weight_cache.h"

namespace revisit::engine {

std::shared_ptr<const PackedWeights> WeightCache::get(const PackedWeightsKey& key,
                                                      const Pack& pack) {
  // Held while packing: another plan of the net waits for the same weights more often than not.
  const std::lock_guard lock(mutex_);
  if (const auto found = entries_.find(key); found != entries_.end())
    if (auto weights = found->second.lock()) return weights;
  std::erase_if(entries_, [](const auto& entry) { return entry.second.expired(); });
  auto weights = std::make_shared<const PackedWeights>(pack());
  entries_.insert_or_assign(key, weights);
  return weights;
}

int64_t WeightCache::bytes_in_use() const {
  const std::lock_guard lock(mutex_);
  int64_t bytes = 0;
  for (const auto& [key, entry] : entries_)
    if (const auto weights = entry.lock()) bytes += weights->bytes();
  return bytes;
}

}  // namespace revisit::engine
