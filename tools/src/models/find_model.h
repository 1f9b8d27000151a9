#pragma once

#include <array>
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "revisit/weights_conversion/known_models.h"

namespace revisit::models {

/// Empty: not given.
struct ModelRequest {
  std::filesystem::path model;    // --model: a prototxt, a folder with one, or a known model's name
  std::filesystem::path weights;  // --weights: a caffemodel
  std::string end, graft;         // --end, --graft
  std::optional<std::array<double, 3>> mean_bgr;
};

struct FoundModel {
  std::string name;  // the known model's, or the one in the prototxt
  std::filesystem::path prototxt, weights;
  std::string weights_sha1;
  std::array<double, 3> mean_bgr{};   // to be subtracted, in 0..255
  Cut cut;                            // where the feature is taken: as asked, or as suggested
  bool trained = true;                // false: `revisit models make-random` made it
  std::vector<std::string> warnings;  // for the user, e.g. that the mean is a guess
};

/// Finds the network to use: what the request names, else the first known model in the cache
/// (cache.h), else what $REVISIT_MODELS itself holds, when that is the folder of one model.
///
/// Beside the prototxt or weights the other is looked for: the same name, `deploy.prototxt`, the
/// only one. A known model gets our prototxt (trunks.h). Throws UsageError for no model or several,
/// saying what to do; InputError for a missing file or a cached one with a wrong checksum.
FoundModel find_model(const ModelRequest& request);

}  // namespace revisit::models
