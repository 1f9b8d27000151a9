#pragma once

#include <google/protobuf/repeated_field.h>

#include <vector>

#include "reports.pb.h"
#include "revisit/pipeline/precision_recall.h"

namespace revisit::cli {

/// The points of a curve that are seen when it is drawn: at most a few hundred, the first and the
/// last among them. Nothing for a curve without positives.
google::protobuf::RepeatedPtrField<reports::CurvePoint> drawn_points(
    const std::vector<pipeline::PrPoint>& curve);

}  // namespace revisit::cli
