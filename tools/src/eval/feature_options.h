#pragma once

#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "cli/geometry_options.h"
#include "cli/parser.h"
#include "models/find_model.h"
#include "revisit/datasets/dataset.h"
#include "revisit/datasets/describe.h"
#include "revisit/datasets/observer.h"
#include "revisit/evaluation/descriptors.h"
#include "revisit/recognition/ring/describe.h"

namespace revisit::cli {

struct FeatureSource;

/// kOneByOne has no options for the cache and PCA of a drive, nor for FAB-MAP.
enum class Scans { kOfDrives, kOneByOne };

struct FeatureOptions {
  std::filesystem::path data;
  std::string sequence;
  int every = 1;  // only frames whose number is a multiple of this
  GeometryOptions image;
  std::string feature = "cnn";
  std::filesystem::path model, weights;
  std::string end, graft, mean_bgr;
  double input_scale = 1;      // of the pixels less their mean, as caffe's transform_param has it
  std::filesystem::path ring;  // the model of rings
  pipeline::RingOptions ring_options;
  std::filesystem::path images, training_images;  // of FAB-MAP
  std::string new_place = "mean-field";
  int64_t ring_key_candidates = 0;   // of Scan Context; 0: all
  std::optional<std::string> align;  // absent: the feature's own way
  int threads = 0;                   // 0: all cores
  int threads_per_scan = 1;          // of one forward pass
  engine::Precision precision = engine::Precision::kFloat32;
  std::string pca;  // components(), as given
  std::string fit_on = "all";
  double memory_gb = 2;
  std::string cache;    // folder of the features; "" means below the output folder
  std::string mount;    // of Scans::kOneByOne: parse_mount(); "": as the points are
  bool strict = false;  // a scan that cannot be described ends the work; false: it is left out
  bool no_progress = false, quiet = false;

  void declare(Parser& parser, Scans scans = Scans::kOfDrives);
  /// The same without the data.
  void declare_describing(Parser& parser, Scans scans);
  /// Throws UsageError for a feature whose library is not built in, and for an option on the
  /// command line that no feature uses, like --end with --feature data: one of the two is a
  /// mistake. (Files and the environment may hold more.)
  static void check_given(const Parser& parser, const std::vector<std::string>& features);
  void check_given(const Parser& parser) const { check_given(parser, {feature}); }
  /// False for the options of other features.
  bool uses(const std::string& option) const;
  int thread_count() const;
  /// Of the PCA; 0: all; -1: no PCA; absent: the feature's own way. Throws UsageError.
  std::optional<int64_t> components() const;
  /// How `source` is described and reduced.
  pipeline::DescribeOptions describe(const FeatureSource& source) const;
  pipeline::ReductionOptions reduction(const FeatureSource& source) const;
  /// Notes, warnings and progress on stderr, as far as they are wanted; Ctrl-C stops the work.
  pipeline::Observer observer() const;
  /// The folder the features go to, of a command with this output folder.
  std::filesystem::path cache_folder(const std::filesystem::path& output) const;
};

/// cnn, data, ring and the competitors.
std::vector<std::string> feature_names();

struct FeatureSource {
  pipeline::FeatureExtractor extractor;
  std::optional<models::FoundModel> model;  // absent for all but cnn
  pipeline::Dataset inputs;                 // what is described: the scans, or their camera images
  pipeline::AlignCase align = pipeline::AlignCase::kNone;
  int64_t components = -1;  // of the PCA; 0: all; -1: no PCA
};

/// "cosine", or "similarity" when the feature has one of its own.
std::string similarity_name(const FeatureSource& source);

/// Loads the network or makes another feature. FAB-MAP learns its words here, into `folder`. Warns
/// of an untrained network. Throws UsageError for options that do not fit the feature.
FeatureSource open_feature(const FeatureOptions& options, const pipeline::Dataset& dataset,
                           const std::filesystem::path& folder);

/// Resolves `--sensor auto` by some scans, where the feature sees range images: for rings to the
/// sensor of the nearest model. Returns what was found, for people; "" when there was nothing to
/// find. `map`: whose model is preferred, when there is such a map.
std::string resolve_sensor(FeatureOptions& options, const pipeline::Dataset& dataset,
                           const std::filesystem::path& map = {});

/// Warns when the scans cannot be the view of a sensor that stands upright (misfit_of_view()).
void warn_of_view(const FeatureOptions& options, const pipeline::Dataset& dataset);

/// The sensor that the first scans look like they were taken by; "" when none is known.
std::string sensor_of(const pipeline::Dataset& dataset);

/// Warns when the scans look like those of another known sensor than the model's.
void warn_of_other_sensor(const pipeline::Dataset& dataset, const std::string& sensor);

/// The scans of the data set that `options.every` takes, so far: of one that grows perhaps none.
/// Throws InputError, UsageError.
pipeline::Dataset scans_so_far(const FeatureOptions& options,
                               const pipeline::DatasetNeeds& needs = {});
/// The same of one that is complete: says its warnings, and throws UsageError for no scans.
pipeline::Dataset open_scans(const FeatureOptions& options,
                             const pipeline::DatasetNeeds& needs = {});

}  // namespace revisit::cli
