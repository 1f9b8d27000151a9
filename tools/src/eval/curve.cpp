#include "eval/curve.h"

#include <algorithm>
#include <cmath>

namespace revisit::cli {
namespace {

constexpr double kStep = 1.0 / 400;  // smaller steps are invisible
constexpr size_t kMaxPoints = 600;

}  // namespace

reports::Curve drawn_curve(const std::vector<PrPoint>& curve) {
  std::vector<const PrPoint*> kept;
  for (const PrPoint& point : curve) {
    if (std::isnan(point.recall) || std::isnan(point.precision)) continue;
    const bool last = &point == &curve.back();
    if (kept.empty() || last ||
        std::abs(point.recall - kept.back()->recall) +
                std::abs(point.precision - kept.back()->precision) >=
            kStep)
      kept.push_back(&point);
  }
  reports::Curve points;
  const size_t stride = std::max<size_t>(1, (kept.size() + kMaxPoints - 1) / kMaxPoints);
  for (size_t i = 0; i < kept.size(); ++i) {
    if (i % stride != 0 && i + 1 != kept.size()) continue;
    points.add_threshold(rounded(kept[i]->threshold, 1e-5));
    points.add_precision(rounded(kept[i]->precision, 1e-5));
    points.add_recall(rounded(kept[i]->recall, 1e-5));
  }
  return points;
}

float rounded(double value, double step) {
  return static_cast<float>(std::round(value / step) * step);
}

}  // namespace revisit::cli
