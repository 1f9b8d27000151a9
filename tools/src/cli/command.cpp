#include "command.h"

#include <algorithm>
#include <iomanip>
#include <iostream>

#include "cli/command_line.h"
#include "cli/renamed.h"
#include "revisit/base/error.h"

namespace revisit::cli {
namespace {

CommandLine describe_all(const std::string& program, const std::vector<Command>& table) {
  CommandLine line;
  line.command = program;
  line.options = {{"help", 'h', {}}};
  for (const Command& command : table)
    if (!command.hidden) line.below.push_back(describe(command.run));
  return line;
}

}  // namespace

const std::vector<std::pair<ExitCode, const char*>>& exit_codes() {
  static const std::vector<std::pair<ExitCode, const char*>> codes = {
      {kOk, "ok"},
      {kFailed, "failed"},
      {kUsage, "usage"},
      {kBadInput, "input unreadable or malformed"},
      {kUnsupported, "model not supported"},
      {kCheckFailed, "a check failed"},
      {kScansSkipped, "done, but some scans were skipped"},
      {kInterrupted, "interrupted (partial results are kept)"}};
  return codes;
}

bool have_option(const Arguments& arguments, const std::string& option, const std::string& value) {
  const auto found = std::ranges::find(arguments, option);
  return std::ranges::count(arguments, option + "=" + value) > 0 ||
         (found != arguments.end() && found + 1 != arguments.end() && found[1] == value);
}

int dispatch(const std::string& program, const char* introduction,
             const std::vector<Command>& table, const Arguments& arguments) {
  if (asks_for_description(arguments)) throw Described{describe_all(program, table)};
  if (arguments.size() > 1 && arguments[0] == "help") {
    Arguments with_help(arguments.begin() + 1, arguments.end());
    with_help.push_back("--help");
    return dispatch(program, introduction, table, with_help);
  }
  if (arguments.empty() || arguments[0] == "--help" || arguments[0] == "--help=all" ||
      arguments[0] == "-h" || arguments[0] == "help") {
    std::ostream& out = arguments.empty() ? std::cerr : std::cout;
    out << introduction << "\nUsage: " << program << " COMMAND [ARGUMENTS]\n\n";
    for (const Command& command : table)
      if (!command.hidden)
        out << "  " << std::left << std::setw(12) << command.name << command.summary << "\n";
    out << "\n'" << program << " COMMAND --help' explains one command, with examples.\n";
    return arguments.empty() ? kUsage : kOk;
  }
  const std::string name = current_command(program, arguments[0]);
  if (name != arguments[0]) warn_deprecated(program + " " + arguments[0], program + " " + name);
  std::vector<std::string> names;
  for (const Command& command : table) {
    if (name == command.name) return command.run({arguments.begin() + 1, arguments.end()});
    if (!command.hidden) names.emplace_back(command.name);
  }
  throw UsageError("unknown command '", program, " ", arguments[0], "'",
                   nearest_name_hint(arguments[0], names), "; '", program, " --help' lists them");
}

}  // namespace revisit::cli
