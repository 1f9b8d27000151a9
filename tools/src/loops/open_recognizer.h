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
/// Throws UsageError for a feature that learns from whole drives (--pca, but for --pca-fit DIR) and
/// for options without a meaning here.
RecognizerSource recognizer_source(FeatureOptions& options, const Parser& parser,
                                   const pipeline::Dataset& some);

/// The map in `file`, made when it is missing; none for "".
std::unique_ptr<pipeline::MapStore> map_for(const std::filesystem::path& file,
                                            const RecognizerSource& source,
                                            pipeline::NumberFormat format);

}  // namespace revisit::cli
