#pragma once

#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "feature_options.h"

namespace revisit::cli {

/// The features other than the method's own that --feature takes.
std::vector<std::string> competitor_names();

/// The optional library that one of them needs; nothing for those that need none, and other names.
std::optional<std::string> library_of_competitor(const std::string& name);

/// The feature `options.feature`, one of competitor_names(). FAB-MAP learns its words first (or
/// finds them in `folder`), with progress on stderr. Throws UsageError for options that it refuses
/// and for a feature that this build does not have.
pipeline::FeatureExtractor competitor(const FeatureOptions& options,
                                      const pipeline::Dataset& dataset,
                                      const std::filesystem::path& folder);

}  // namespace revisit::cli
