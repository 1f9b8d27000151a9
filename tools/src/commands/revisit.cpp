#include <iostream>

#include "cli/built_in.h"
#include "cli/command.h"
#include "revisit/base/error.h"

namespace revisit::cli {
namespace {

std::string introduction() {
  constexpr size_t kWidth = 90;
  std::string text =
      "revisit: place recognition from LiDAR scans with original Caffe networks.\n\n";
  std::string line = "Exit codes:";
  for (const auto& [code, meaning] : exit_codes()) {
    const std::string entry = str(" ", static_cast<int>(code), " ", meaning,
                                  code == exit_codes().back().first ? "." : ";");
    if (line.size() + entry.size() > kWidth) {
      text += line + "\n";
      line = entry.substr(1);
    } else {
      line += entry;
    }
  }
  return text + line + "\n";
}

}  // namespace

int revisit_command(const Arguments& arguments) {
  if (!arguments.empty() && (arguments[0] == "--version" || arguments[0] == "version")) {
    std::cout << "revisit " << REVISIT_VERSION << "\n";
#ifdef REVISIT_HAVE_PIPELINE
    std::cout << built_in_text();
#else
    std::cout << "built in: the engine alone, `revisit net`\n";
#endif
    return kOk;
  }
  const std::vector<Command> commands = {
#ifdef REVISIT_HAVE_PIPELINE
      {"loops", "detect loop closures in a drive, a folder of scans or a bag", loops_command},
      {"map", "maps: build, query, merge, remove, prune, check", map_command},
      {"eval", "evaluate against ground truth: precision, recall, plots", eval_command},
      {"robustness", "evaluate features on perturbed scans", robustness_command},
      {"experiment", "the experiments of the paper", experiment_command},
      {"summarize", "mean and standard deviation over runs, e.g. of several seeds",
       summarize_command},
      {"report", "one HTML file of runs, experiments and loops", report_command},
      {"describe", "compute the descriptors of scans", describe_command},
      {"train", "train a ring model on drives", train_command},
      {"calibrate", "calibrate the scores of a ring model", calibrate_command},
      {"image", "write the range image of a scan as PNG", image_command},
      {"gt", "print the ground truth: number and list of true pairs", gt_command},
      {"simulate", "simulate a drive in KITTI's layout", simulate_command},
      {"models", "known Caffe models: list, fetch, make-random", models_command},
      {"doctor", "check the installation, models and data", doctor_command},
#endif
      {"net", "run a Caffe net: inspect, forward, profile, verify", net_command},
      {"completion", "completion script for bash", completion_command, true},
  };
  return dispatch("revisit", introduction().c_str(), commands, arguments);
}

}  // namespace revisit::cli
