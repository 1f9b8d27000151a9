#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "cli/command.h"
#include "eval/feature_options.h"
#include "eval/truth_options.h"
#include "revisit/evaluation/robustness.h"

namespace revisit::cli {

struct RobustnessCommand {
  FeatureOptions feature;  // its name is the given list
  std::vector<std::string> features;
  std::string label;  // of the only feature; "": its name
  std::vector<std::filesystem::path> among;
  TruthOptions truth;
  RobustnessOptions options;  // without description and reduction
  std::filesystem::path output = "results";
  std::string format = "table";
  bool no_report = false;
};

RobustnessCommand parse_robustness(const Arguments& arguments);

}  // namespace revisit::cli
