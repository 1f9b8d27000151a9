#pragma once

#include <string>

#include "revisit/pipeline/dataset.h"

namespace revisit::pipeline {

/// The version of the code that turns scans into features: alignment, projection, closing, the
/// network's kernels, the descriptors of `baselines/`. To be raised with every change after which
/// the features of some scan are others (beyond the last digits of a float), so that features kept
/// by an earlier program are not taken for this one's. The tests FeatureVersion.* hold a checksum
/// of a fixed scan's features and fail when that was forgotten.
constexpr int kFeatureVersion = 1;

/// Identifies the files of a data set by path, size, number and times of change of the content and
/// of the entry (which a copied time stamp does not hide): reading them all would take as long as
/// describing them.
std::string dataset_key(const Dataset& dataset);

}  // namespace revisit::pipeline
