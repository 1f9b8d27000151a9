#pragma once

#include <optional>
#include <string>
#include <vector>

#include "cli/command.h"

namespace revisit::cli {

/// One curve of an experiment, as experiments.yaml has it.
struct CurveInfo {
  std::string label;            // what distinguishes it within its panel
  std::string feature = "cnn";  // --feature; "cnn" is the method itself
  Arguments options;            // of `revisit eval`, those of all curves among them
  bool needs_training = false;
  std::optional<std::string> parameters;  // of the comparison's methods, for people
  std::optional<double> paper_frames_per_second;
};

/// A statement about two curves of every panel that the results confirm or not:
/// AP of `better` >= AP of `worse` - slack.
struct Claim {
  std::string text, better, worse;
  double slack = 0;
};

/// One of the paper's nine experiments.
struct ExperimentInfo {
  std::string name;                    // as on the command line
  std::string title;                   // for people
  std::string question;                // what is compared
  std::string paper;                   // what the paper finds
  std::vector<std::string> sequences;  // of drives; or the name of the set of places
  bool places = false;                 // a set of places
  bool every_layer = false;            // also every layer of every network
  std::vector<CurveInfo> curves;
  std::vector<Claim> claims;
  std::string note;  // what a reader must know; or ""
};

/// All of them, in the order of the paper's section IV.
const std::vector<ExperimentInfo>& experiments();

/// The entry called `name`. Throws UsageError with the nearest name.
const ExperimentInfo& find_experiment(const std::string& name);

}  // namespace revisit::cli
