#pragma once

#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "feature_options.h"

namespace revisit::cli {

std::vector<std::string> baseline_names();

/// Absent if the baseline needs none, and for another name.
std::optional<std::string> library_of_baseline(const std::string& name);

/// FAB-MAP trains its vocabulary, or reads it from `folder`. Throws UsageError if an option does
/// not fit or the library is not built in.
FeatureExtractor baseline(const FeatureOptions& options, const Dataset& dataset,
                          const std::filesystem::path& folder);

}  // namespace revisit::cli
