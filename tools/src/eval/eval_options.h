#pragma once

#include <filesystem>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "cli/command.h"
#include "eval/feature_options.h"
#include "eval/truth_options.h"
#include "revisit/maps/place_recognizer.h"

namespace revisit::cli {

struct EvalOptions {
  FeatureOptions feature;
  TruthOptions truth;
  std::filesystem::path output = "results";
  std::string protocol = "online", query_case = "protocol", format = "table";
  std::optional<std::string> score;  // absent: that of the feature and the protocol
  std::optional<std::string> distance, exclusion;
  std::optional<double> radius, other_beyond;
  int k = 4;
  int resamples = 1000;  // bootstrap; 0: none
  std::optional<std::string> block;
  bool causal = false, no_verify = false;
  std::string keyframes = "all";
  int64_t warmup = RecognizerOptions().warmup;
  bool no_report = false;

  void declare(Options& options);
};

/// Options and values ("" if absent or unused) for config.yaml, with absolute paths.
std::vector<std::pair<std::string, std::string>> settings_of(const EvalOptions& options);

/// Command that repeats an evaluation, without options that have their default.
std::string command_of(const EvalOptions& options);

}  // namespace revisit::cli
