#pragma once

#include <cmath>
#include <cstdint>
#include <numbers>

namespace revisit::simulation {

inline constexpr double kDegree = std::numbers::pi / 180;  // [rad]

/// The finalizer of splitmix64 (Steele, Lea, Flood 2014): a bijection that mixes every bit.
constexpr uint64_t mix(uint64_t x) {
  x += 0x9e3779b97f4a7c15u;
  x = (x ^ (x >> 30)) * 0xbf58476d1ce4e5b9u;
  x = (x ^ (x >> 27)) * 0x94d049bb133111ebu;
  return x ^ (x >> 31);
}

/// Counter-based: the value for (seed, a, b) does not depend on the order of calls, nor on threads.
constexpr uint64_t random_bits(uint64_t seed, uint64_t a, uint64_t b = 0) {
  return mix(mix(mix(seed) ^ a) ^ b);
}

/// Uniform in [0, 1) from the upper 24 bits: exact in float.
constexpr float unit_float(uint64_t bits) {
  return static_cast<float>(bits >> 40) * 0x1p-24f;
}

/// Standard normal by Box and Muller from the two halves of `bits`.
inline float normal_float(uint64_t bits) {
  const float u = (static_cast<float>(bits >> 40) + 0.5f) * 0x1p-24f;  // never 0: the log is finite
  const float v = static_cast<float>(bits & 0xffffffu) * 0x1p-24f;
  return std::sqrt(-2 * std::log(u)) * std::cos(2 * std::numbers::pi_v<float> * v);
}

/// Sequence that is equal with every standard library.
class Random {
 public:
  explicit Random(uint64_t seed, uint64_t purpose = 0) : key_(random_bits(seed, purpose)) {}

  double uniform() { return static_cast<double>(next() >> 11) * 0x1p-53; }
  double uniform(double low, double high) { return low + (high - low) * uniform(); }
  bool chance(double probability) { return uniform() < probability; }
  /// Inclusive.
  int integer(int low, int high) { return low + static_cast<int>(uniform() * (high - low + 1)); }
  double normal(double sigma) { return sigma * static_cast<double>(normal_float(next())); }

 private:
  uint64_t next() { return mix(key_ + counter_++ * 0x632be59bd9b4e019u); }
  uint64_t key_, counter_ = 0;
};

/// Smooth field in [0, 1] with features of about `wavelength` [m]: a lattice blended by smoothstep.
inline double value_noise(uint64_t seed, double x, double y, double wavelength) {
  const double u = x / wavelength, v = y / wavelength;
  const double fu = std::floor(u), fv = std::floor(v);
  const auto at = [&](int du, int dv) {
    const auto i = static_cast<uint64_t>(static_cast<int64_t>(fu) + du);
    const auto j = static_cast<uint64_t>(static_cast<int64_t>(fv) + dv);
    return static_cast<double>(unit_float(random_bits(seed, i, j)));
  };
  const auto smooth = [](double t) { return t * t * (3 - 2 * t); };
  const double a = smooth(u - fu), b = smooth(v - fv);
  return (1 - b) * ((1 - a) * at(0, 0) + a * at(1, 0)) + b * ((1 - a) * at(0, 1) + a * at(1, 1));
}

}  // namespace revisit::simulation
