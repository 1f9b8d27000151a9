#pragma once

#include <filesystem>
#include <memory>

#include "eval/feature_options.h"
#include "revisit/maps/place_recognizer.h"

namespace revisit::cli {

/// A recogniser's feature and settings as the options say, for scans of the sensor of `some`.
struct RecognizerSource {
  pipeline::FeatureExtractor extractor;
  pipeline::RecognizerOptions options;
};
/// Whether all cores work on one scan, or each on its own.
enum class ScansAtOnce { kOne, kMany };
/// `map`: may be missing. Throws UsageError for a feature that learns from whole drives (--pca, but
/// for --fit-on DIR).
RecognizerSource recognizer_source(FeatureOptions& options, const pipeline::Dataset& some,
                                   const std::filesystem::path& map,
                                   ScansAtOnce at_once = ScansAtOnce::kOne);

}  // namespace revisit::cli
