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

Command revisit_program() {
  return {"revisit",
          "place recognition from LiDAR scans with original Caffe networks",
          introduction(),
          "",
          {},
          {
#ifdef REVISIT_HAVE_PIPELINE
              loops_command(), map_command(), eval_command(), report_command(), train_command(),
              calibrate_command(), simulate_command(), models_command(), doctor_command(),
#endif
              net_command(), completion_command()}};
}

int run_revisit(const Arguments& arguments) {
  if (arguments.empty() || (arguments[0] != "--version" && arguments[0] != "version"))
    return run(revisit_program(), "revisit", arguments);
  std::cout << "revisit " << REVISIT_VERSION << "\n";
#ifdef REVISIT_HAVE_PIPELINE
  std::cout << built_in_text();
#else
  std::cout << "built in: the engine alone, `revisit net`\n";
#endif
  return kOk;
}

}  // namespace revisit::cli
