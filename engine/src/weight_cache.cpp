#include "weight_cache.h"

#include <unistd.h>

#include "process_lock.h"

namespace revisit::engine {

std::shared_ptr<const PackedWeights> WeightCache::get(const PackedWeightsKey& key,
                                                      const Pack& pack) {
  const std::shared_ptr<std::mutex> packing = packing_of_process();
  // Held while packing, because other plans of the net usually need the same weights.
  const std::scoped_lock one_packs(*packing);
  if (auto weights = find(key)) return weights;
  auto weights = std::make_shared<const PackedWeights>(pack());
  const std::scoped_lock lock(process_lock());
  std::erase_if(entries_, [](const auto& entry) { return entry.second.expired(); });
  entries_.insert_or_assign(key, weights);
  return weights;
}

int64_t WeightCache::bytes_in_use() const {
  const std::scoped_lock lock(process_lock());
  int64_t bytes = 0;
  for (const auto& [key, entry] : entries_)
    if (const auto weights = entry.lock()) bytes += weights->bytes();
  return bytes;
}

std::shared_ptr<std::mutex> WeightCache::packing_of_process() {
  const std::scoped_lock lock(process_lock());
  if (process_ != ::getpid()) {
    process_ = ::getpid();
    packing_ = std::make_shared<std::mutex>();
  }
  return packing_;
}

std::shared_ptr<const PackedWeights> WeightCache::find(const PackedWeightsKey& key) const {
  const std::scoped_lock lock(process_lock());
  const auto found = entries_.find(key);
  return found == entries_.end() ? nullptr : found->second.lock();
}

}  // namespace revisit::engine
