#include "nearest_neighbors.h"

#include <algorithm>
#include <limits>

namespace revisit {
namespace {

constexpr int kLanes = 8;           // points compared at once
constexpr float kRounding = 1e-3F;  // of coordinates, less than this [m]

}  // namespace

NearestNeighbors::NearestNeighbors(const std::vector<Eigen::Vector3f>& points, float square)
    : square_(square), per_meter_(1 / square), least_(points[0]) {
  Eigen::Vector3f most = points[0];
  for (const Eigen::Vector3f& point : points) {
    least_ = least_.cwiseMin(point);
    most = most.cwiseMax(point);
  }
  rows_ = 1 + static_cast<int>((most.x() - least_.x()) * per_meter_);
  columns_ = 1 + static_cast<int>((most.y() - least_.y()) * per_meter_);
  std::vector<uint32_t> cells;
  cells.reserve(points.size());
  starts_.resize(static_cast<size_t>(rows_) * static_cast<size_t>(columns_) + 1);
  for (const Eigen::Vector3f& point : points) {
    const int row = steps(point.x(), least_.x(), rows_);
    const int cell = row * columns_ + steps(point.y(), least_.y(), columns_);
    cells.push_back(static_cast<uint32_t>(cell));
    ++starts_[cells.back() + 1];
  }
  for (size_t i = 1; i < starts_.size(); ++i) starts_[i] += starts_[i - 1];
  std::vector<uint32_t> next(starts_.begin(), starts_.end() - 1);
  order_.resize(points.size());
  sorted_.setConstant(std::ssize(points) + kLanes - 1, 3, std::numeric_limits<float>::infinity());
  for (uint32_t i = 0; i < points.size(); ++i) {
    const uint32_t at = next[cells[i]]++;
    order_[at] = i;
    sorted_.row(at) = points[i];
  }
}

template <class Take>
bool NearestNeighbors::search_run(uint32_t begin, uint32_t end, const Eigen::Vector3f& place,
                                  float& limit, const Take& take) const {
  using Lanes = Eigen::Array<float, kLanes, 1>;
  for (uint32_t at = begin; at < end; at += kLanes) {
    const auto lanes = [&](int axis) { return Lanes::Map(&sorted_(at, axis)) - place[axis]; };
    const Lanes squared = lanes(0).square() + lanes(1).square() + lanes(2).square();
    if (!(squared.head<kLanes / 2>().min(squared.tail<kLanes / 2>()).minCoeff() < limit)) continue;
    for (uint32_t i = at; i < std::min(at + kLanes, end); ++i)
      if (squared[i - at] < limit && !take(squared[i - at], i)) return false;
  }
  return true;
}

template <class Take>
void NearestNeighbors::search(const Eigen::Vector3f& place, float& limit, const Take& take) const {
  // False if the row is out of reach, or at the end of the search.
  const auto visit = [&](int row) {
    const float from = least_.x() + static_cast<float>(row) * square_;
    const float across = std::max({0.F, from - place.x(), place.x() - from - square_}) - kRounding;
    const float rest = across > 0 ? limit - across * across : limit;
    if (!(rest > 0)) return false;
    const float reach = std::sqrt(rest) + kRounding;
    const int first = row * columns_ + steps(place.y() - reach, least_.y(), columns_);
    const int last = row * columns_ + steps(place.y() + reach, least_.y(), columns_);
    return search_run(starts_[static_cast<size_t>(first)], starts_[static_cast<size_t>(last) + 1],
                      place, limit, take);
  };
  const int middle = steps(place.x(), least_.x(), rows_);
  visit(middle);
  for (int row = middle - 1; row >= 0 && visit(row);) --row;
  for (int row = middle + 1; row < rows_ && visit(row);) ++row;
}

size_t NearestNeighbors::nearest(const Eigen::Vector3f& place, float limit,
                                 std::span<Neighbor> found) const {
  size_t count = 0;
  search(place, limit, [&](float squared, uint32_t at) {
    size_t i = count < found.size() ? count++ : count - 1;
    for (; i > 0 && found[i - 1].squared > squared; --i) found[i] = found[i - 1];
    found[i] = {squared, order_[at]};
    if (count == found.size()) limit = found.back().squared;
    return true;
  });
  return count;
}

bool NearestNeighbors::any_within(const Eigen::Vector3f& place, float limit) const {
  bool found = false;
  search(place, limit, [&](float, uint32_t) {
    found = true;
    limit = 0;
    return false;
  });
  return found;
}

}  // namespace revisit
