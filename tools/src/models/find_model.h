#pragma once

#include <array>
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "revisit/weights_conversion/known_models.h"

namespace revisit::models {

/// Empty options were not given.
struct ModelRequest {
  std::filesystem::path model;  // a prototxt, a folder with one, or a known model's name
  std::filesystem::path weights;
  std::string end;  // "conv3" or "conv3+pool5"
  std::optional<std::array<double, 3>> mean_bgr;
};

struct FoundModel {
  std::string name;  // of the known model, or in the prototxt
  std::filesystem::path prototxt, weights;
  std::string weights_sha1;
  std::array<double, 3> mean_bgr{};  // to be subtracted, 0 to 255
  std::string cut;                   // layer of the feature, given or suggested
  bool trained = true;               // false: from `revisit models make-random`
  std::vector<std::string> warnings;
};

/// Finds a network: the requested one, else the first known model in the cache (cache.h), else the
/// model in $REVISIT_MODELS itself, if that is the folder of one model.
///
/// Looks for the weights beside a given prototxt, and vice versa: the same name, `deploy.prototxt`,
/// or the only one. A known model gets our prototxt (own_net()). Throws UsageError if there is no
/// model or several, and InputError for a missing file or a cached file with a wrong checksum.
FoundModel find_model(const ModelRequest& request);

/// Models in and below `folders` (default: the cache), trained ones first; of models with one name
/// only the first. Warns of unusable caffemodels. Throws UsageError for a missing folder.
std::vector<FoundModel> all_models(const std::vector<std::filesystem::path>& folders);

/// Layers for features: those suggested for a known model, else the one that was found.
std::vector<std::string> cuts_of(const FoundModel& model);

}  // namespace revisit::models
