#include <iostream>

#include "cli/built_in.h"
#include "cli/command.h"
#include "revisit/base/error.h"

namespace revisit::cli {
namespace {

/// What the program is, and its exit codes in lines for a terminal.
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
      {"eval", "place recognition with ground truth: precision, recall, plots", eval_command},
      {"summarize", "mean and standard deviation over runs, e.g. of several seeds",
       summarize_command},
      {"experiment", "the experiments of the paper, each one command", experiment_command},
      {"robustness", "how features stand scans that are altered as robots alter them",
       robustness_command},
      {"report", "one HTML file of runs and experiments, with interactive figures", report_command},
      {"describe", "scans -> descriptors", describe_command},
      {"loops", "scans as they come -> places seen before", loops_command},
      {"map", "places that are kept: build, query, merge, remove, forget, check", map_command},
      {"learn", "drives -> a ring model, for --feature ring", learn_command},
      {"calibrate", "a ring model -> how sure its matches are, for loops", calibrate_command},
      {"image", "the range image the network sees, as PNG", image_command},
      {"gt", "the ground truth itself: number and list of true pairs", gt_command},
      {"simulate", "a KITTI-layout data set in a synthetic town", simulate_command},
      {"models", "known Caffe models: list, fetch, make-random", models_command},
      {"doctor", "what works here and what is missing", doctor_command},
#endif
      {"net", "a Caffe net alone: inspect, forward, profile", net_command},
      {"completion", "completion for bash, which packages install", completion_command, true},
  };
  return dispatch("revisit", introduction().c_str(), commands, arguments);
}

}  // namespace revisit::cli
