#include "eval/curve.h"

#include <algorithm>
#include <cmath>

namespace revisit::cli {
namespace {

constexpr double kStep = 1.0 / 400;  // less is not seen
constexpr size_t kMostPoints = 600;

}  // namespace

google::protobuf::RepeatedPtrField<reports::CurvePoint> drawn_points(
    const std::vector<pipeline::PrPoint>& curve) {
  std::vector<const pipeline::PrPoint*> kept;
  for (const pipeline::PrPoint& point : curve) {
    if (std::isnan(point.recall) || std::isnan(point.precision)) continue;
    const bool last = &point == &curve.back();
    if (kept.empty() || last ||
        std::abs(point.recall - kept.back()->recall) +
                std::abs(point.precision - kept.back()->precision) >=
            kStep)
      kept.push_back(&point);
  }
  google::protobuf::RepeatedPtrField<reports::CurvePoint> points;
  const size_t stride = std::max<size_t>(1, (kept.size() + kMostPoints - 1) / kMostPoints);
  for (size_t i = 0; i < kept.size(); ++i) {
    if (i % stride != 0 && i + 1 != kept.size()) continue;
    reports::CurvePoint& point = *points.Add();
    point.set_threshold(kept[i]->threshold);
    point.set_precision(kept[i]->precision);
    point.set_recall(kept[i]->recall);
  }
  return points;
}

}  // namespace revisit::cli
