#pragma once

#include <string>
#include <vector>

namespace revisit::cli {

/// One of the paper's nine experiments.
struct ExperimentInfo {
  std::string name;      // as on the command line
  std::string title;     // for people
  std::string question;  // what is compared
  std::string paper;     // what the paper finds
};

/// All of them, in the order of the paper's section IV.
const std::vector<ExperimentInfo>& experiments();

/// The entry called `name`. Throws UsageError with the nearest name.
const ExperimentInfo& find_experiment(const std::string& name);

/// A row of the paper's Table II, to stand beside ours, or a method that is compared besides.
struct PaperMethod {
  std::string feature;  // our --feature; "cnn" is the method itself
  std::string method;
  bool needs_training = false;
  std::string parameters;
  double frames_per_second = 0;  // on its 3.2 GHz CPU, one thread; 0: not in the paper
  bool in_paper = true;
};
const std::vector<PaperMethod>& paper_methods();

}  // namespace revisit::cli
