#pragma once

#include "models/find_model.h"

namespace revisit::models {

/// The models in `folders` and below them, of one name the first: trained ones, then others, each
/// in the order of the known models. Adds to `passed_over` why a caffemodel is none.
std::vector<FoundModel> all_models(const std::vector<std::filesystem::path>& folders,
                                   std::vector<std::string>* passed_over);

/// The known model that this is, or that it stands in for with random weights; or null.
const KnownModel* known_model_of(const FoundModel& model);

}  // namespace revisit::models
