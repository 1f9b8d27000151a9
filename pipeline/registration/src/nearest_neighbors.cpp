#include "nearest_neighbors.h"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "nearest_neighbors.cpp"
#include <hwy/foreach_target.h>
// After foreach_target.h.
#include <hwy/highway.h>

#include <algorithm>
#include <cmath>
#include <limits>

HWY_BEFORE_NAMESPACE();
namespace revisit::HWY_NAMESPACE {
namespace {

namespace hn = hwy::HWY_NAMESPACE;
constexpr hn::CappedTag<float, 8> kD;  // points compared at once

/// take(squared distance, position in the sorted points) of points below `limit`, which it lowers.
template <class Take>
HWY_INLINE void search_run(const PointSquares& squares, uint32_t begin, uint32_t end,
                           const Eigen::Vector3f& place, const float& limit, const Take& take) {
  const auto lanes = static_cast<uint32_t>(hn::Lanes(kD));
  for (uint32_t at = begin; at < end; at += lanes) {
    const auto square_of = [&](int axis, float to) {
      const auto apart = hn::Sub(hn::LoadU(kD, &squares.sorted(at, axis)), hn::Set(kD, to));
      return hn::Mul(apart, apart);
    };
    const auto squared =
        hn::Add(hn::Add(square_of(0, place.x()), square_of(1, place.y())), square_of(2, place.z()));
    if (hn::AllFalse(kD, hn::Lt(squared, hn::Set(kD, limit)))) continue;
    HWY_ALIGN float values[8];
    hn::Store(squared, kD, values);
    for (uint32_t i = at; i < std::min(at + lanes, end); ++i)
      if (values[i - at] < limit) take(values[i - at], i);
  }
}

size_t nearest_simd(const PointSquares& squares, const Eigen::Vector3f& place, float limit,
                    std::span<Neighbor> found) {
  constexpr float kRounding = 1e-3F;  // of coordinates, less than this [m]
  const Eigen::Vector3f& least = squares.least;
  size_t count = 0;
  const auto take = [&](float squared, uint32_t at) {
    size_t i = count < found.size() ? count++ : count - 1;
    for (; i > 0 && found[i - 1].squared > squared; --i) found[i] = found[i - 1];
    found[i] = {squared, squares.order[at]};
    if (count == found.size()) limit = found.back().squared;
  };
  // False if the row is out of reach.
  const auto visit = [&](int row) HWY_ATTR {
    const float from = least.x() + static_cast<float>(row) * squares.edge;
    const float across =
        std::max({0.F, from - place.x(), place.x() - from - squares.edge}) - kRounding;
    const float rest = across > 0 ? limit - across * across : limit;
    if (!(rest > 0)) return false;
    const float reach = std::sqrt(rest) + kRounding;
    const auto square_at = [&](float y) {
      return static_cast<size_t>(row * squares.columns +
                                 squares.steps(y, least.y(), squares.columns));
    };
    search_run(squares, squares.starts[square_at(place.y() - reach)],
               squares.starts[square_at(place.y() + reach) + 1], place, limit, take);
    return true;
  };
  const int middle = squares.steps(place.x(), least.x(), squares.rows);
  visit(middle);
  for (int row = middle - 1; row >= 0 && visit(row);) --row;
  for (int row = middle + 1; row < squares.rows && visit(row);) ++row;
  return count;
}

}  // namespace
}  // namespace revisit::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace revisit {

HWY_EXPORT(nearest_simd);

NearestNeighbors::NearestNeighbors(const std::vector<Eigen::Vector3f>& points, float square) {
  constexpr int kPadding = 7;  // the last vector begins at the last point
  PointSquares& to = squares_;
  to.edge = square;
  to.per_meter = 1 / square;
  Eigen::Vector3f most = to.least = points[0];
  for (const Eigen::Vector3f& point : points) {
    to.least = to.least.cwiseMin(point);
    most = most.cwiseMax(point);
  }
  to.rows = 1 + static_cast<int>((most.x() - to.least.x()) * to.per_meter);
  to.columns = 1 + static_cast<int>((most.y() - to.least.y()) * to.per_meter);
  std::vector<uint32_t> cells;
  cells.reserve(points.size());
  to.starts.resize(static_cast<size_t>(to.rows) * static_cast<size_t>(to.columns) + 1);
  for (const Eigen::Vector3f& point : points) {
    const int row = to.steps(point.x(), to.least.x(), to.rows);
    const int cell = row * to.columns + to.steps(point.y(), to.least.y(), to.columns);
    cells.push_back(static_cast<uint32_t>(cell));
    ++to.starts[cells.back() + 1];
  }
  for (size_t i = 1; i < to.starts.size(); ++i) to.starts[i] += to.starts[i - 1];
  std::vector<uint32_t> next(to.starts.begin(), to.starts.end() - 1);
  to.order.resize(points.size());
  to.sorted.setConstant(std::ssize(points) + kPadding, 3, std::numeric_limits<float>::infinity());
  for (uint32_t i = 0; i < points.size(); ++i) {
    const uint32_t at = next[cells[i]]++;
    to.order[at] = i;
    to.sorted.row(at) = points[i];
  }
}

size_t NearestNeighbors::nearest(const Eigen::Vector3f& place, float limit,
                                 std::span<Neighbor> found) const {
  return HWY_DYNAMIC_DISPATCH(nearest_simd)(squares_, place, limit, found);
}

}  // namespace revisit
#endif  // HWY_ONCE
