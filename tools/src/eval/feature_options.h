#pragma once

#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "cli/geometry_options.h"
#include "cli/options.h"
#include "models/models.h"
#include "revisit/datasets/dataset.h"
#include "revisit/datasets/describe.h"
#include "revisit/datasets/observer.h"
#include "revisit/evaluation/descriptors.h"
#include "revisit/recognition/ring/descriptor.h"

namespace revisit::cli {

struct FeatureSource;

/// kOneByOne: no options of the cache and PCA of a drive, and no FAB-MAP. kStored: none of queries
/// either.
enum class Scans { kOfDrives, kOneByOne, kStored };

struct FeatureOptions {
  std::filesystem::path data;
  std::string sequence;  // or the topic of a bag
  std::string topics;    // of a bag, to be merged
  std::filesystem::path extrinsics;
  int every = 1;                     // frame stride
  std::string point_times = "auto";  // unit of the times of points
  GeometryOptions image;
  std::string feature = "ring";
  std::filesystem::path model, weights;
  std::string end, mean_bgr;  // end: parse_cut()
  std::filesystem::path ring;
  std::string images;                 // DIR[,DIR], for FAB-MAP
  std::optional<int64_t> candidates;  // 0: all
  int64_t default_candidates = 0;     // of ring and scan-context
  std::optional<std::string> align;   // absent: the feature's default
  int threads = 0;                    // 0: all cores
  int threads_per_scan = 1;
  engine::Precision precision = engine::Precision::kFloat32;
  std::string pca;  // components() or a folder, as given
  std::string fit_on = "all";
  double memory_gb = 2;
  std::string cache;     // folder of the features; "": below the output folder
  std::string mount;     // unless Scans::kOfDrives: parse_mount(); "": identity
  double local_map = 0;  // MapOptions::local_map [m]
  bool quiet = false;

  void declare(Options& options, Scans scans = Scans::kOfDrives);
  void declare_data(Options& options);
  void declare_threads(Options& options);
  void declare_local_map(Options& options);
  /// Declares all options but those of the data.
  void declare_describing(Options& options, Scans scans);
  int thread_count() const;
  /// Candidates of ring and scan-context.
  int64_t preselected() const { return candidates.value_or(default_candidates); }
  /// Candidates from an HNSW graph, of a feature that is compared by cosine; 0: no graph. Not for
  /// Scans::kOfDrives.
  int64_t graph_candidates() const {
    const bool has_codes = feature == "ring" || feature == "scan-context";
    return has_codes ? 0 : candidates.value_or(0);
  }
  /// Components of the PCA; 0: all; -1: no PCA; absent: the feature's default. Throws UsageError.
  std::optional<int64_t> components() const;
  /// Scans that the PCA is estimated from: "all", "map", or a folder with a PCA.
  std::string fitted_on() const;
  DescribeOptions describe(const FeatureSource& source) const;
  ReductionOptions reduction(const FeatureSource& source) const;
  /// Notes, warnings and progress on stderr unless --quiet; Ctrl-C stops the work.
  Observer observer() const;
  std::filesystem::path cache_folder(const std::filesystem::path& output) const;

 private:
  void declare_cnn(Options& options, bool of_drives);
  void declare_ring(Options& options, Scans scans);
  void declare_baselines(Options& options);
  void declare_running(Options& options, bool of_drives);
};

std::vector<std::string> feature_names();
/// Absent if the feature needs none.
std::optional<std::string> library_of_baseline(const std::string& name);

struct FeatureSource {
  FeatureExtractor extractor;
  std::optional<models::FoundModel> model;  // only for cnn
  Dataset inputs;                           // scans, or their camera images
  AlignCase align = AlignCase::kNone;
  int64_t components = -1;  // of the PCA; 0: all; -1: no PCA
};

/// FAB-MAP trains its vocabulary into `folder`. Prints a note for an untrained network. Throws
/// UsageError if options do not fit the feature.
FeatureSource open_feature(const FeatureOptions& options, const Dataset& dataset,
                           const std::filesystem::path& folder);

/// Resolves `--sensor auto` from some scans if the feature uses range images; for rings, to the
/// sensor of the nearest model. Returns a message, "" if nothing was resolved. `map_key`:
/// feature_key_of() an existing map, whose model is preferred.
std::string resolve_sensor(FeatureOptions& options, const Dataset& dataset,
                           const std::string& map_key = "");

/// Warns if the scans cannot come from an upright sensor (find_view_defect()).
void warn_of_view(const FeatureOptions& options, const Dataset& dataset);

/// Known sensor that the first scans resemble; "" if there is none.
std::string sensor_of(const Dataset& dataset);

void warn_of_other_sensor(const Dataset& dataset, const std::string& sensor);

/// Scans of the data set at the stride `options.every`; perhaps none yet, if the data set grows.
/// Throws InputError, UsageError.
Dataset scans_so_far(const FeatureOptions& options, bool needs_poses = false);
/// Scans of a complete data set. Prints its warnings; throws UsageError if there is no scan.
Dataset open_scans(const FeatureOptions& options, bool needs_poses = false);
/// Those of `data` instead. Warns if another sensor than `sensor` made them.
Dataset open_drive(FeatureOptions options, const std::filesystem::path& data,
                   const std::string& sensor, bool needs_poses);
/// "1200 scans of town/00, 900 scans of village".
std::string names_of(const std::vector<Dataset>& drives);

/// Fraction of points outside of the image above which the geometry is probably wrong.
inline constexpr double kManyOutside = 0.1;

/// Warning that names a sensor that fits. `share`: fraction of the points.
std::string points_outside(double share, const ImageGeometry& geometry, const PointCloud& scan);

/// Warns if the median over the projected scans is above kManyOutside.
void warn_of_points_outside(const FeatureOptions& options, const Dataset& dataset,
                            const std::vector<AlignmentRecord>& records);

}  // namespace revisit::cli
