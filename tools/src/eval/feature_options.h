#pragma once

#include <filesystem>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "cli/parser.h"
#include "models/find_model.h"
#include "revisit/pipeline/dataset.h"
#include "revisit/pipeline/describe.h"
#include "revisit/pipeline/pca.h"

namespace revisit::cli {

/// What every command that describes scans takes: data, network, geometry.
struct FeatureOptions {
  std::filesystem::path data;
  std::string sequence;
  std::string sensor = "hdl64";
  int width = 0, height = 0;  // 0: the sensor's
  double max_range = 0;       // [m]; 0: the sensor's
  std::string feature = "net";
  std::filesystem::path model, weights;
  std::string end, graft, mean_bgr;
  int threads = 0;  // 0: all cores
  int64_t components = 400;
  std::string pca_fit = "all";
  double memory_gb = 2;
  std::string cache;  // folder of the features; "" means below the output folder
  bool no_progress = false, quiet = false;

  void declare(Parser& parser);
  pipeline::ImageGeometry geometry() const;
  int thread_count() const;
};

/// The feature and where it comes from, for people and for run.json.
struct FeatureSource {
  pipeline::FeatureExtractor extractor;
  std::optional<models::FoundModel> model;  // absent for `data`
};

/// Loads the network (or takes the range image itself). Warnings, and the plain word that a network
/// is untrained, go to stderr.
FeatureSource open_feature(const FeatureOptions& options);

/// A finished feature file with its alignments.
struct Features {
  pipeline::FeatureFile file;
  std::vector<pipeline::AlignmentRecord> alignments;
};

/// Describes all scans in one alignment mode, or takes the finished file from the cache. Progress
/// on stderr; Ctrl-C throws Interrupted and keeps what was done. Times are appended to `times`.
Features compute_features(const FeatureOptions& options, const pipeline::Dataset& dataset,
                          const FeatureSource& source, pipeline::AlignMode align,
                          const std::filesystem::path& folder, pipeline::DescribeTimes* times);

}  // namespace revisit::cli
