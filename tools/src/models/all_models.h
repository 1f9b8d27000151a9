#pragma once

#include "models/find_model.h"

namespace revisit::models {

/// The models in `folders` and below them, without folders those in the cache; of one name the
/// first. Trained ones come first, then others, each in the order of the known models. Warns of
/// caffemodels that cannot be used. Throws UsageError for folders that do not exist.
std::vector<FoundModel> all_models(const std::vector<std::filesystem::path>& folders);

/// Where to take features from a model: as suggested for a known one, else as it was found.
std::vector<Cut> cuts_of(const FoundModel& model);

}  // namespace revisit::models
