#pragma once

#include "models/find_model.h"

namespace revisit::models {

/// The models in and below `folders` (default: the cache), the first of one name; trained ones come
/// first. Warns of unusable caffemodels. Throws UsageError for folders that do not exist.
std::vector<FoundModel> all_models(const std::vector<std::filesystem::path>& folders);

/// Where to take features from a model: as suggested for a known one, else as it was found.
std::vector<Cut> cuts_of(const FoundModel& model);

}  // namespace revisit::models
