#pragma once

#include <cstdint>
#include <cstdlib>
#include <memory>
#include <span>

namespace revisit::engine {

/// Uninitialized floats aligned to a cache line for SIMD kernels.
class AlignedFloats {
 public:
  AlignedFloats() = default;
  /// Throws std::bad_alloc.
  explicit AlignedFloats(int64_t size);

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

template <class Values>
AlignedFloats padded(const Values& values, int64_t size) {
  AlignedFloats result(size);
  const auto used = static_cast<int64_t>(values.size());
  for (int64_t i = 0; i < size; ++i)
    result.data()[i] = i < used ? static_cast<float>(values[static_cast<size_t>(i)]) : 0.0F;
  return result;
}

}  // namespace revisit::engine
