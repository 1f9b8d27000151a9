#pragma once

#include <malloc.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <numbers>
#include <random>
#include <string>
#include <vector>

#include "revisit/base/error.h"
#include "revisit/maps/map_store.h"
#include "ring/describer.h"

namespace revisit {

inline double wall_seconds() {
  return std::chrono::duration<double>(std::chrono::steady_clock::now().time_since_epoch()).count();
}

/// Of all arenas.
inline double heap_bytes() {
  const struct mallinfo2 heap = ::mallinfo2();
  return double(heap.uordblks + heap.hblkhd);
}

inline double quantile(std::vector<double> values, double share) {
  std::ranges::sort(values);
  return values[std::min(values.size() - 1, size_t(share * double(values.size())))];
}

/// Draws Gaussian numbers from a table, because generating 10^9 takes long.
class Noise {
 public:
  Noise() {
    std::mt19937 of_table(2);
    std::normal_distribution<float> gaussian;
    for (float& number : table_) number = gaussian(of_table);
  }
  const float* draw(size_t n) { return table_.data() + random() % (table_.size() - n); }

  std::mt19937_64 random{3};

 private:
  std::vector<float> table_ = std::vector<float>(1 << 22);
};

template <class Vector>
void normalize(Vector& x) {
  double square = 0;
  for (const float v : x) square += double(v) * double(v);
  for (float& v : x) v = float(v / std::sqrt(square));
}

/// A map of ring descriptors.
struct RingMap {
  std::vector<MapEntry> entries;
  std::string projection;
  RingLayout layout;

  explicit RingMap(const std::string& file) {
    const auto map = open_map(file, MapAccess::kRead);
    map->read(
        0, [&](MapEntry&& entry) { entries.push_back(std::move(entry)); },
        [](const std::string& problem) { throw InputError(problem); });
    projection = map->value(kProjectionValue).value();
    layout = RingDescriber(parse_ring_model(projection, file)).layout();
  }
};

/// Entries of a map, then randomly rotated copies of them, each with its own noise.
class Places {
 public:
  explicit Places(const RingMap& map) : map_(map), spread_(size_t(dim_of(map.layout))) {
    for (const MapEntry& entry : map.entries)
      for (size_t j = 0; j < spread_.size(); ++j)
        spread_[j] += entry.descriptor[j] * entry.descriptor[j] / float(map.entries.size());
    for (float& square : spread_) square = std::sqrt(square);
  }
  int64_t dim() const { return int64_t(spread_.size()); }
  std::vector<float> next() {
    const int64_t i = made_++, real = int64_t(map_.entries.size());
    return i < real ? map_.entries[size_t(i)].descriptor : copy_of(i % real, 1);
  }
  std::vector<float> copy_of(int64_t entry, float amount) {
    std::vector<float> x = map_.entries[size_t(entry)].descriptor;
    const float* const noise = noise_.draw(x.size());
    for (size_t j = 0; j < x.size(); ++j) x[j] += amount * noise[j] * spread_[j];
    normalize(x);
    rotate(x, double(noise_.random() % 100000) * 2e-5 * std::numbers::pi);
    return x;
  }

 private:
  void rotate(std::vector<float>& x, double angle) const {
    size_t at = 0;
    for (size_t f = 0; f < map_.layout.size(); ++f) {
      const auto n = size_t(map_.layout[f]);
      const auto c = float(std::cos(angle * double(f))), s = float(std::sin(angle * double(f)));
      for (size_t i = at; f > 0 && i < at + n; ++i) {
        const float real = x[i], imaginary = x[n + i];
        x[i] = c * real - s * imaginary;
        x[n + i] = s * real + c * imaginary;
      }
      at += f > 0 ? 2 * n : n;
    }
  }

  const RingMap& map_;
  std::vector<float> spread_;
  Noise noise_;
  int64_t made_ = 0;
};

/// Fills each of the maps with `count` entries, opens them in two processes, and prints the figures
/// of docs/reference/SPEED.md.
void measure_server(const RingMap& map, int64_t count, const std::vector<std::string>& urls);

}  // namespace revisit
