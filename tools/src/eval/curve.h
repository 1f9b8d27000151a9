#pragma once

#include <vector>

#include "reports.pb.h"
#include "revisit/evaluation/precision_recall.h"

namespace revisit::cli {

/// At most a few hundred points for drawing, with the first and the last; none without positives.
reports::Curve drawn_curve(const std::vector<PrPoint>& curve);

float rounded(double value, double step);

}  // namespace revisit::cli
