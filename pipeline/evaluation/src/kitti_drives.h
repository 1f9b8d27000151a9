#pragma once

#include <string>

#include "revisit/evaluation/ground_truth.h"

namespace revisit::pipeline {

/// Frames that a publication lists for KITTI's drive `sequence` mean nothing on another drive of
/// that name. Throws UsageError, naming the protocol, unless `trajectory` belongs to a drive with
/// as many poses as the official one (also when only some of its scans are there).
void need_official_drive(const std::string& protocol, const std::string& sequence,
                         const Trajectory& trajectory);

}  // namespace revisit::pipeline
