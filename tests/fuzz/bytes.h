#pragma once

#include <algorithm>
#include <cstring>
#include <span>
#include <string>

namespace revisit::fuzz {

/// Consumes a case from its front; yields 0 and "" at its end.
class Bytes {
 public:
  Bytes(const uint8_t* data, size_t size) : left_(data, size) {}
  bool empty() const { return left_.empty(); }

  template <class Number>
  Number number() {
    Number taken{};
    const std::span<const uint8_t> bytes = take(sizeof taken);
    if (!bytes.empty()) std::memcpy(&taken, bytes.data(), bytes.size());
    return taken;
  }
  /// Range: [0, most].
  size_t up_to(uint8_t most) { return number<uint8_t>() % (most + 1U); }
  std::string text(size_t size) {
    const std::span<const uint8_t> bytes = take(size);
    return {bytes.begin(), bytes.end()};
  }

 private:
  std::span<const uint8_t> take(size_t size) {
    const auto taken = left_.first(std::min(size, left_.size()));
    left_ = left_.subspan(taken.size());
    return taken;
  }

  std::span<const uint8_t> left_;
};

}  // namespace revisit::fuzz
