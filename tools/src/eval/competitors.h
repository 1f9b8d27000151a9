#pragma once

#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "feature_options.h"

namespace revisit::cli {

std::vector<std::string> competitor_names();

/// The optional library that one of them needs; nothing for those that need none, and other names.
std::optional<std::string> library_of_competitor(const std::string& name);

/// FAB-MAP learns its words first, or finds them in `folder`. Throws UsageError for options that
/// the feature refuses, and for a feature that this build does not have.
pipeline::FeatureExtractor competitor(const FeatureOptions& options,
                                      const pipeline::Dataset& dataset,
                                      const std::filesystem::path& folder);

}  // namespace revisit::cli
