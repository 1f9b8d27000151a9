#pragma once

#include "models/find_model.h"

namespace revisit::models {

/// Models in and below `folders` (default: the cache), trained ones first; of models with one name
/// only the first. Warns of unusable caffemodels. Throws UsageError for a missing folder.
std::vector<FoundModel> all_models(const std::vector<std::filesystem::path>& folders);

/// Layers for features: those suggested for a known model, else the one that was found.
std::vector<Cut> cuts_of(const FoundModel& model);

}  // namespace revisit::models
