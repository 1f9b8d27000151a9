#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "cli/command.h"
#include "eval/feature_options.h"
#include "eval/truth_options.h"
#include "revisit/evaluation/robustness.h"

namespace revisit::cli {

struct RobustnessRun {
  FeatureOptions feature;  // its name is the given list
  std::vector<std::string> features;
  std::string label;  // of the only feature; "": its name
  std::vector<std::filesystem::path> among;
  TruthOptions truth;
  RobustnessOptions evaluation;  // without description and reduction
  std::filesystem::path output = "results";
  std::string format = "table";
  bool no_report = false;

  void declare(Options& options);

 private:
  std::vector<std::string> perturbations_;
  std::string distance_ = "xz", exclusion_, query_case_ = "1";

  void finish();
};

}  // namespace revisit::cli
