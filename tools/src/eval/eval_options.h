#pragma once

#include <filesystem>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "cli/command.h"
#include "eval/feature_options.h"
#include "loops/scan_stream.h"
#include "revisit/evaluation/evaluate.h"
#include "revisit/maps/map.h"

namespace revisit::cli {

struct TruthOptions {
  PoseOptions poses;
  std::string pairs;  // files and settings, separated by commas; see declare()

  void declare(Options& options);
  bool has_own() const { return !pairs.empty() || !poses.file.empty(); }
  /// Scans of open_scans(), with the poses of the file if there is one.
  Dataset open(const FeatureOptions& data, bool needs_poses) const;
  /// Absent without pairs. Throws what read_pairs() throws.
  std::optional<ListedPairs> listed(const FeatureOptions& data) const;
};

/// The default protocol, which no task of the library has.
inline constexpr const char* kDrivingOrder = "driving-order";

struct EvalOptions {
  FeatureOptions feature;
  TruthOptions truth;
  std::filesystem::path output = "results";
  std::string protocol = kDrivingOrder, query_case = "protocol", format = "table";
  std::optional<std::string> score;  // absent: that of the feature and the protocol
  std::optional<std::string> distance, exclusion;
  std::optional<double> radius, negative_radius;
  int k = 4;
  std::string bootstrap = "1000";  // resamples(), perhaps with block()
  std::string keyframes = "all";
  std::string odometry_gate = "none";
  int64_t warmup = MapOptions().warmup;
  bool no_report = false;
  // Perturbed queries; lists separated by commas.
  std::string perturb, distractors;
  uint32_t seed = 0;
  int64_t queries = 200;
  // Other work than one evaluation.
  std::string plan;
  std::filesystem::path ground_truth, descriptors;  // files to write

  int resamples() const;      ///< of the bootstrap; 0: none
  std::string block() const;  ///< length of a block, "": the default
  void declare(Options& options);
  bool in_driving_order() const { return perturb.empty() && protocol == kDrivingOrder; }

 private:
  void declare_evaluation(Options& options);
  void declare_driving_order(Options& options);
  void declare_perturbed(Options& options);
  void declare_output(Options& options);
  /// Throws UsageError.
  void check(const Options& options) const;
};

/// Of a run of a plan. Throws UsageError.
EvalOptions parse_eval_options(const Arguments& arguments);

/// Options that change results, and their values (not those that are absent or of other features),
/// for run.json, with absolute paths.
std::map<std::string, std::string> settings_of(const EvalOptions& options);

/// Command that repeats an evaluation, without options that have their default.
std::string command_of(const EvalOptions& options);

/// Perturbations of a list, or the standard ones. Throws UsageError.
std::vector<Perturbation> parse_perturbations(const std::string& list);

/// Reads a flat YAML map for Options::config(), or the options of a run.json. Throws InputError
/// with file:line:column.
std::vector<std::pair<std::string, std::string>> read_config_file(
    const std::filesystem::path& file);

}  // namespace revisit::cli
