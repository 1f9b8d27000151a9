#pragma once

#include <vector>

#include "reports.pb.h"
#include "revisit/evaluation/precision_recall.h"

namespace revisit::cli {

/// At most a few hundred points to draw, with the first and last; nothing without positives.
reports::Curve drawn_curve(const std::vector<pipeline::PrPoint>& curve);

/// A number with the digits that are seen when it is drawn: a multiple of `step`.
float rounded(double value, double step);

}  // namespace revisit::cli
