#pragma once

#include <cmath>
#include <cstdint>
#include <vector>

namespace revisit::random_nets {

/// splitmix64 (Steele, Lea, Flood 2014); deterministic on every platform.
class Random {
 public:
  explicit Random(uint64_t seed) : state_(seed) {}

  uint64_t next() {
    uint64_t z = state_ += 0x9E3779B97F4A7C15;
    z = (z ^ (z >> 30)) * 0xBF58476D1CE4E5B9;
    z = (z ^ (z >> 27)) * 0x94D049BB133111EB;
    return z ^ (z >> 31);
  }
  /// Range: [first, last].
  int64_t between(int64_t first, int64_t last) {
    return first + static_cast<int64_t>(next() % static_cast<uint64_t>(last - first + 1));
  }
  bool chance(double probability) { return unit() < probability; }
  /// Range: [low, high), in steps of a 1024th of the range.
  double real(double low, double high) {
    return low + (high - low) * static_cast<double>(between(0, 1023)) / 1024;
  }
  template <class T>
  const T& of(const std::vector<T>& choices) {
    return choices[static_cast<size_t>(between(0, static_cast<int64_t>(choices.size()) - 1))];
  }

 private:
  double unit() { return static_cast<double>(next() >> 11) * 0x1.0p-53; }
  uint64_t state_;
};

}  // namespace revisit::random_nets
