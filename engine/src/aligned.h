#pragma once

#include <algorithm>
#include <cstdint>
#include <cstdlib>
#include <memory>
#include <new>
#include <span>

namespace revisit::engine {

/// Floats from a cache line on, as SIMD kernels want them. Not initialised.
class AlignedFloats {
 public:
  AlignedFloats() = default;
  /// Throws std::bad_alloc.
  explicit AlignedFloats(int64_t size) : size_(size) {
    constexpr size_t kCacheLine = 64;
    const size_t bytes = static_cast<size_t>(size) * sizeof(float);
    data_.reset(
        static_cast<float*>(std::aligned_alloc(kCacheLine, (bytes / kCacheLine + 1) * kCacheLine)));
    if (!data_) throw std::bad_alloc();
  }

  float* data() const { return data_.get(); }
  int64_t size() const { return size_; }
  std::span<float> values() const { return {data(), static_cast<size_t>(size_)}; }

 private:
  struct Free {
    void operator()(float* memory) const { std::free(memory); }
  };
  std::unique_ptr<float[], Free> data_;
  int64_t size_ = 0;
};

}  // namespace revisit::engine
