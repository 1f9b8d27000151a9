#pragma once

#include <filesystem>
#include <string>

#include "revisit/datasets/describe.h"

namespace revisit {

inline constexpr std::vector<double> DescribeTimes::*kDescribeStages[] = {
    &DescribeTimes::read,    &DescribeTimes::align, &DescribeTimes::project,  &DescribeTimes::close,
    &DescribeTimes::feature, &DescribeTimes::write, &DescribeTimes::processor};

/// Floats of AlignmentRecord.
inline constexpr int64_t kAlignmentFloats = 6;

/// Describes the scans that `file` lacks. Returns their times, empty if it was complete.
DescribeTimes write_features(const std::filesystem::path& file, const std::string& key,
                             const Dataset& dataset, const FeatureExtractor& extractor,
                             const DescribeOptions& options, const Observer& observer);

}  // namespace revisit
