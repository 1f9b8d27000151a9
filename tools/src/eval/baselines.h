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

/// FAB-MAP learns its words or finds them in `folder`. Throws UsageError: refused, not built in.
pipeline::FeatureExtractor competitor(const FeatureOptions& options,
                                      const pipeline::Dataset& dataset,
                                      const std::filesystem::path& folder);

}  // namespace revisit::cli
