#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <numeric>

#include "revisit/base/error.h"
#include "revisit/baselines/baselines.h"

namespace revisit {
namespace {

/// Empty columns stay zero.
struct UnitColumns {
  UnitColumns(std::span<const float> context, const ScanContextOptions& options, int repeats)
      : width(options.sectors * repeats),
        values(static_cast<size_t>(options.rings) * width),
        occupied(static_cast<size_t>(width)) {
    for (int column = 0; column < options.sectors; ++column) {
      double squares = 0;
      for (int ring = 0; ring < options.rings; ++ring) {
        const double value = context[static_cast<size_t>(ring) * options.sectors + column];
        squares += value * value;
      }
      const double scale = squares > 0 ? 1 / std::sqrt(squares) : 0;
      for (int at = column; at < width; at += options.sectors) {
        occupied[static_cast<size_t>(at)] = squares > 0 ? 1 : 0;
        for (int ring = 0; ring < options.rings; ++ring)
          values[static_cast<size_t>(ring) * width + at] = static_cast<float>(
              scale * context[static_cast<size_t>(ring) * options.sectors + column]);
      }
    }
  }

  int width;
  std::vector<float> values;    // [rings][width]
  std::vector<float> occupied;  // [width], 0 or 1
};

/// cosines[shift] = sum over j of dot(a[:, j + shift], b[:, j]); `a` is stored twice in a row.
double least_distance(const UnitColumns& a, const UnitColumns& b,
                      const ScanContextOptions& options) {
  const int sectors = options.sectors;
  std::vector<float> cosines(static_cast<size_t>(sectors)), pairs(static_cast<size_t>(sectors));
  for (int column = 0; column < sectors; ++column) {
    if (b.occupied[static_cast<size_t>(column)] == 0) continue;
    for (int shift = 0; shift < sectors; ++shift)
      pairs[static_cast<size_t>(shift)] +=
          a.occupied[static_cast<size_t>(column) + static_cast<size_t>(shift)];
    for (int ring = 0; ring < options.rings; ++ring) {
      const float value = b.values[static_cast<size_t>(ring) * b.width + column];
      if (value == 0) continue;
      const float* const row = a.values.data() + static_cast<size_t>(ring) * a.width + column;
      for (int shift = 0; shift < sectors; ++shift)
        cosines[static_cast<size_t>(shift)] += value * row[shift];
    }
  }
  double least = std::numeric_limits<double>::infinity();
  for (size_t shift = 0; shift < cosines.size(); ++shift)
    least = std::min(least, pairs[shift] > 0 ? 1 - double{cosines[shift]} / pairs[shift] : 1);
  return least;
}

void check(const ScanContextOptions& options) {
  constexpr int kMost = 1000;
  if (options.rings < 1 || options.rings > kMost || options.sectors < 1 || options.sectors > kMost)
    throw UsageError("scan context: expected 1 to ", kMost, " rings and sectors, found ",
                     options.rings, " and ", options.sectors);
  if (!(options.max_range > 0) || !std::isfinite(options.max_range) ||
      !std::isfinite(options.sensor_height))
    throw UsageError("scan context: expected a positive range and a finite height, found ",
                     options.max_range, " and ", options.sensor_height);
  if (options.candidates < 0)
    throw UsageError("scan context: expected at least 0 candidates, found ", options.candidates);
}

/// On a tie, the lower index.
std::vector<size_t> nearest_ring_keys(std::span<const float> query,
                                      std::span<const std::span<const float>> places, int64_t count,
                                      const ScanContextOptions& options) {
  const std::vector<float> query_key = ring_key(query, options);
  std::vector<std::pair<double, size_t>> order;
  for (size_t i = 0; i < places.size(); ++i) {
    const std::vector<float> key = ring_key(places[i], options);
    double squares = 0;
    for (size_t ring = 0; ring < key.size(); ++ring)
      squares += (double{key[ring]} - query_key[ring]) * (double{key[ring]} - query_key[ring]);
    order.emplace_back(squares, i);
  }
  const int64_t kept = std::min(count, static_cast<int64_t>(order.size()));
  std::partial_sort(order.begin(), order.begin() + kept, order.end());
  std::vector<size_t> positions;
  for (int64_t i = 0; i < kept; ++i) positions.push_back(order[static_cast<size_t>(i)].second);
  return positions;
}

}  // namespace

void scan_context(const PointCloud& cloud, const ScanContextOptions& options,
                  std::span<float> context) {
  constexpr float kEmpty = std::numeric_limits<float>::lowest();
  constexpr double kTurn = 2 * std::numbers::pi;
  std::ranges::fill(context, kEmpty);
  for (const Point& point : cloud.points) {
    if (!is_return(point)) continue;
    const double range = std::hypot(double{point.x}, double{point.y});
    if (range > options.max_range) continue;
    double azimuth = std::atan2(double{point.y}, double{point.x});
    if (azimuth < 0) azimuth += kTurn;
    const int ring =
        std::min(static_cast<int>(range / options.max_range * options.rings), options.rings - 1);
    const int sector =
        std::min(static_cast<int>(azimuth / kTurn * options.sectors), options.sectors - 1);
    float& bin = context[static_cast<size_t>(ring) * options.sectors + sector];
    bin = std::max(bin, static_cast<float>(point.z + options.sensor_height));
  }
  std::ranges::replace(context, kEmpty, 0.0F);
}

std::vector<float> ring_key(std::span<const float> context, const ScanContextOptions& options) {
  std::vector<float> key;
  for (int ring = 0; ring < options.rings; ++ring) {
    const auto row = context.subspan(static_cast<size_t>(ring) * options.sectors,
                                     static_cast<size_t>(options.sectors));
    const auto occupied = std::count_if(row.begin(), row.end(), [](float h) { return h != 0; });
    key.push_back(static_cast<float>(occupied) / static_cast<float>(options.sectors));
  }
  return key;
}

FeatureExtractor scan_context_features(const ScanContextOptions& options) {
  check(options);
  FeatureExtractor extractor;
  extractor.name = "scan-context";
  extractor.dim = int64_t{options.rings} * options.sectors;
  extractor.key = str("scan-context rings ", options.rings, " sectors ", options.sectors,
                      " max_range ", options.max_range, " sensor_height ", options.sensor_height);
  extractor.make = [options]() -> FeatureFunction<PointCloud> {
    return [options](const PointCloud& cloud, std::span<float> context) {
      scan_context(cloud, options, context);
    };
  };
  extractor.comparison.similarity = [options](std::span<const float> query,
                                              std::span<const std::span<const float>> places,
                                              std::span<double> similarities) {
    const UnitColumns query_columns(query, options, 2);
    std::vector<size_t> compared;
    if (options.candidates > 0) {
      std::fill(similarities.begin(), similarities.end(), -1);
      compared = nearest_ring_keys(query, places, options.candidates, options);
    } else {
      compared.resize(places.size());
      std::iota(compared.begin(), compared.end(), size_t{0});
    }
    for (const size_t i : compared) {
      const UnitColumns other(places[i], options, 1);
      similarities[i] = 1 - least_distance(query_columns, other, options);
    }
  };
  return extractor;
}

}  // namespace revisit
