#pragma once

#include <string>
#include <utility>
#include <vector>

namespace revisit::cli {

enum ExitCode {
  kOk = 0,
  kFailed = 1,
  kUsage = 2,
  kBadInput = 3,
  kUnsupported = 4,
  kCheckFailed = 5,
  kScansSkipped = 6,
  kInterrupted = 130
};

const std::vector<std::pair<ExitCode, const char*>>& exit_codes();

using Arguments = std::vector<std::string>;

/// Finds `--option value` before parsing, because it needs none of the required arguments.
bool have_option(const Arguments& arguments, const std::string& option, const std::string& value);

/// `run` gets the arguments after the verb and returns an ExitCode, or throws Error.
struct Command {
  const char* name;
  const char* summary;
  int (*run)(const Arguments&);
  bool hidden = false;
};

/// Runs the command named by `arguments[0]`, also by a former name (cli/renamed.h). Throws
/// UsageError for an unknown command, and Described for a description.
int dispatch(const std::string& program, const char* introduction,
             const std::vector<Command>& table, const Arguments& arguments);

int revisit_command(const Arguments&);

int net_command(const Arguments&);
int image_command(const Arguments&);
int describe_command(const Arguments&);
int train_command(const Arguments&);
int calibrate_command(const Arguments&);
int loops_command(const Arguments&);
int map_command(const Arguments&);
int map_remove_command(const Arguments&);
int map_prune_command(const Arguments&);
int eval_command(const Arguments&);
int summarize_command(const Arguments&);
int experiment_command(const Arguments&);
int robustness_command(const Arguments&);
int report_command(const Arguments&);
int gt_command(const Arguments&);
int simulate_command(const Arguments&);
int models_command(const Arguments&);
int doctor_command(const Arguments&);
int completion_command(const Arguments&);

}  // namespace revisit::cli
