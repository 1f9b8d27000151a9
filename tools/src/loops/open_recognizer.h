#pragma once

#include <filesystem>
#include <memory>
#include <optional>

#include "eval/feature_options.h"
#include "revisit/maps/place_recognizer.h"

namespace revisit::cli {

struct RecognizerSource {
  FeatureExtractor extractor;
  RecognizerOptions options;
  std::optional<models::FoundModel> model = {};  // for a network
  int64_t components = -1;                       // components of the PCA; -1: none
};
/// kOne: all cores work on one scan; kMany: each on its own.
enum class ScansAtOnce { kOne, kMany };
/// `map` need not exist. A PCA comes from a folder (--fit-on DIR), or is estimated from the first
/// `warmup` distinct map entries. An estimated PCA is not kept in maps, and all descriptors before
/// it are zero. Throws UsageError for a feature that needs all scans of a drive.
RecognizerSource recognizer_source(FeatureOptions& options, const Dataset& some,
                                   const std::filesystem::path& map,
                                   ScansAtOnce at_once = ScansAtOnce::kOne,
                                   std::optional<int64_t> warmup = std::nullopt);

}  // namespace revisit::cli
