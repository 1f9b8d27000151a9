#pragma once

#include <functional>
#include <memory>
#include <string>
#include <type_traits>
#include <utility>
#include <vector>

#include "cli/options.h"

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

/// Fills lines of a terminal. The first one continues one of `used` columns; others start at
/// `indent`. Ends with a line end.
std::string wrapped(const std::string& text, size_t indent, size_t used);

/// What a command does after its options are parsed. Returns an ExitCode, or throws Error.
using Action = std::function<int()>;

/// A command, or a group of commands `below`, as a value that help, manual pages and completion
/// read without running it.
struct Command {
  std::string name, summary;          // "loops", and a line for lists of commands
  std::string description, examples;  // one paragraph, and lines of "  revisit ..."
  /// Adds the rows of a command to the options, which must outlive the action.
  std::function<Action(Options&)> declare = {};
  std::vector<Command> below = {};
};

/// For Command::declare: a record with `declare(Options&)`, and `run(record)` or
/// `run(record, options)`.
template <class Record, class Run>
std::function<Action(Options&)> with_options(Run run) {
  return [run](Options& options) -> Action {
    const auto record = std::make_shared<Record>();
    record->declare(options);
    return [run, record, &options] {
      if constexpr (std::is_invocable_v<Run, Record&, const Options&>)
        return run(*record, options);
      else
        return run(*record);
    };
  };
}

/// Runs `command`, called `path`, e.g. "revisit map", or the one below it that the first argument
/// names. Throws UsageError for an unknown command.
int run(const Command& command, const std::string& path, const Arguments& arguments);

/// Calls `use` for `command` and all below it, parents first, with its options.
void for_each_command(
    const Command& command, const std::string& path,
    const std::function<void(const Command& command, const Options& options)>& use);

Command revisit_program();
/// A script that completes commands, options and values of `revisit` in bash, and in zsh by
/// bashcompinit.
std::string bash_completion();
/// Runs `revisit` with the arguments of the process.
int run_revisit(const Arguments& arguments);

Command net_command();
Command train_command();
Command calibrate_command();
Command loops_command();
Command locate_command();
Command map_command();
Command map_build_command();
Command map_export_command();
Command eval_command();
Command report_command();
Command models_command();
Command doctor_command();

/// The body of main(): interrupts, messages that are safe to print, and exit codes of errors.
/// `program` begins messages of errors; `run` gets the arguments without the program's name.
int run_main(const std::string& program, int argc, char** argv,
             const std::function<int(const Arguments&)>& run);

}  // namespace revisit::cli
