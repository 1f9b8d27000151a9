#pragma once

#include <filesystem>
#include <memory>
#include <optional>

#include "eval/feature_options.h"
#include "revisit/maps/place_recognizer.h"

namespace revisit::cli {

/// A recogniser's feature and settings as the options say, for scans of the sensor of `some`.
struct RecognizerSource {
  pipeline::FeatureExtractor extractor;
  pipeline::RecognizerOptions options;
  std::optional<models::FoundModel> model = {};  // of a network
  int64_t components = -1;                       // of the PCA; -1: none
};
/// Whether all cores work on one scan, or each on its own.
enum class ScansAtOnce { kOne, kMany };
/// `map`: may be missing. A PCA is one of a folder (--fit-on DIR), or, where none is given, learnt
/// from the first stretch of so many places; that is not kept in maps. Until then all descriptors
/// are zero. Throws UsageError for a feature that learns from whole drives.
RecognizerSource recognizer_source(FeatureOptions& options, const pipeline::Dataset& some,
                                   const std::filesystem::path& map,
                                   ScansAtOnce at_once = ScansAtOnce::kOne,
                                   std::optional<int64_t> first_stretch = std::nullopt);

}  // namespace revisit::cli
