#include <unistd.h>

#include <filesystem>
#include <iostream>
#include <string>
#include <vector>

#include "cli/built_in.h"
#include "cli/command.h"
#include "revisit/base/error.h"

namespace revisit::cli {
namespace {

const std::string kTagline =
    "loop closure detection for LiDAR SLAM, and original Caffe networks, on the CPU";

std::string introduction() {
  const std::string codes = joined(exit_codes(), "; ", [](const auto& one) {
    return str(static_cast<int>(one.first), " ", one.second);
  });
  return wrapped("revisit: " + kTagline + ".", 0, 0) + "\n" +
         wrapped("Exit codes: " + codes + ".", 0, 0);
}

/// Runs revisit-simulate, which is installed beside this program or on PATH, in its place.
[[noreturn]] void run_simulator(const Arguments& arguments) {
  const std::string program = "revisit-simulate";
  std::vector<char*> argv = {const_cast<char*>(program.c_str())};
  for (const std::string& argument : arguments) argv.push_back(const_cast<char*>(argument.c_str()));
  argv.push_back(nullptr);
  std::error_code error;
  const std::filesystem::path own = std::filesystem::read_symlink("/proc/self/exe", error);
  if (!error) execv((own.parent_path() / program).c_str(), argv.data());
  execvp(program.c_str(), argv.data());
  throw UsageError(
      program, " is not installed; build it with tools/build.sh, or install the package revisit");
}

/// For lists of commands; run_revisit() starts the program before options are parsed.
Command simulate_command() {
  return {"simulate",
          "simulate a drive in KITTI's layout (the program revisit-simulate)",
          "",
          "",
          [](Options&) -> Action { return [] { return kOk; }; },
          {}};
}

}  // namespace

Command revisit_program() {
  return {"revisit",
          kTagline,
          introduction(),
          "",
          {},
          {
#ifdef REVISIT_HAVE_PIPELINE
              loops_command(), locate_command(), map_command(), eval_command(), report_command(),
              train_command(), calibrate_command(), simulate_command(), models_command(),
              doctor_command(),
#endif
              net_command()}};
}

int run_revisit(const Arguments& arguments) {
  if (arguments == Arguments{"--completion"}) {
    std::cout << bash_completion();
    return kOk;
  }
#ifdef REVISIT_HAVE_PIPELINE
  if (!arguments.empty() && arguments[0] == "simulate")
    run_simulator({arguments.begin() + 1, arguments.end()});
  if (arguments == Arguments{"help", "simulate"}) run_simulator({"--help"});
#endif
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
