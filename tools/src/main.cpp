#include <unistd.h>

#include <csignal>
#include <iostream>
#include <new>
#include <optional>

#include "cli/blas_choice.h"
#include "cli/command.h"
#include "cli/interrupt.h"
#include "cli/messages.h"
#include "cli/printable.h"
#include "revisit/proto/error.h"

namespace {

using namespace revisit;

constexpr const char* kIntroduction =
    "revisit: place recognition from LiDAR scans with original Caffe networks.\n\n"
    "Exit codes: 0 ok; 1 failed; 2 usage; 3 input unreadable or malformed; 4 model not\n"
    "supported; 5 a check failed; 6 done, but some scans could not be described; 130 interrupted\n"
    "(partial results are kept).\n";

int run(const cli::Arguments& arguments) {
  if (!arguments.empty() && (arguments[0] == "--version" || arguments[0] == "version")) {
    std::cout << "revisit " << REVISIT_VERSION << "\n";
    return cli::kOk;
  }
  const std::vector<cli::Command> commands = {
#ifdef REVISIT_HAVE_PIPELINE
      {"eval", "place recognition with ground truth: precision, recall, plots", cli::eval_command},
      {"summarize", "mean and standard deviation over runs, e.g. of several seeds",
       cli::summarize_command},
      {"experiment", "the experiments of the paper, each one command", cli::experiment_command},
      {"report", "one HTML file of runs and experiments, with interactive figures",
       cli::report_command},
      {"describe", "scans -> descriptors", cli::describe_command},
      {"loops", "scans as they come -> places seen before", cli::loops_command},
      {"map", "places that are kept: info, places, query, merge, check", cli::map_command},
      {"learn", "drives -> a ring model, for --feature ring", cli::learn_command},
      {"image", "the range image the network sees, as PNG", cli::image_command},
      {"gt", "the ground truth itself: number and list of true pairs", cli::gt_command},
      {"simulate", "a KITTI-layout data set in a synthetic town", cli::simulate_command},
      {"models", "known Caffe models: list, fetch, make-random", cli::models_command},
      {"doctor", "what works here and what is missing", cli::doctor_command},
#endif
      {"net", "a Caffe net alone: inspect, forward, profile", cli::net_command},
  };
  return cli::dispatch("revisit", kIntroduction, commands, arguments);
}

int fail(const char* message, int code) {
  std::cerr << "revisit: " << cli::in_our_words(message) << "\n";
  return code;
}

}  // namespace

int main(int argc, char** argv) {
  cli::restart_with_faster_blas(argv);
  cli::watch_for_interrupt();
  std::signal(SIGXFSZ, SIG_IGN);  // a file too large for `ulimit -f` is an error of the write
  // Names in files are not to command the terminal.
  const cli::PrintableStream messages(std::cerr);
  std::optional<cli::PrintableStream> output;
  if (isatty(STDOUT_FILENO)) output.emplace(std::cout);
  try {
    const int code = run({argv + 1, argv + argc});
    std::cout.flush();
    return std::cout ? code : fail("cannot write to standard output", cli::kFailed);
  } catch (const UsageError& error) {
    return fail(error.what(), cli::kUsage);
  } catch (const InputError& error) {
    return fail(error.what(), cli::kBadInput);
  } catch (const UnsupportedError& error) {
    return fail(error.what(), cli::kUnsupported);
  } catch (const Interrupted& error) {
    return fail(error.what(), cli::kInterrupted);
  } catch (const std::bad_alloc&) {
    return fail("out of memory; try a smaller input or fewer threads", cli::kFailed);
  } catch (const std::exception& error) {
    return fail(error.what(), cli::kFailed);
  }
}
