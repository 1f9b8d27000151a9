#include "command.h"

#include <unistd.h>

#include <algorithm>
#include <csignal>
#include <cstdio>
#include <cstdlib>
#include <iomanip>
#include <iostream>
#include <new>
#include <optional>
#include <sstream>

#include "cli/terminal.h"
#include "revisit/base/error.h"

namespace revisit::cli {
namespace {

constexpr size_t kColumns = 79, kHelpColumn = 29;

std::string line_of(const Row& row) {
  std::string line = row.letter ? str("  -", row.letter, ", ") : "      ";
  line += row.spelled();
  if (!row.is_flag()) line += "=" + row.metavar;
  if (line.size() + 2 > kHelpColumn)
    line += "\n" + std::string(kHelpColumn, ' ');
  else
    line.resize(kHelpColumn, ' ');
  return line + wrapped(row.help, kHelpColumn, kHelpColumn);
}

std::string usage_of(const Options& options) {
  std::string usage = "Usage: " + options.command() + " [OPTION...]";
  for (const Row& row : options.rows()) {
    if (!row.is_argument && !row.is_required) continue;
    const std::string word = row.is_argument ? row.name + (row.is_repeatable() ? "..." : "")
                                             : row.spelled() + " " + row.metavar;
    usage += row.is_required ? " " + word : " [" + word + "]";
  }
  return usage + "\n";
}

void print_help(const Command& command, const Options& options, bool all) {
  std::cout << usage_of(options) << wrapped(command.description, 0, 0);
  if (!command.examples.empty()) std::cout << "\nExamples:\n" << command.examples;
  std::cout << "\nOptions:\n";
  const auto is_option = [](const Row& row) { return !row.is_argument; };
  const auto is_common = [](const Row& row) { return row.is_common; };
  all = all || std::ranges::none_of(options.rows(), is_common);
  std::string group;
  for (const Row& row : options.rows()) {
    if (row.is_argument || (!all && !row.is_common)) continue;
    if (all && row.group != group) std::cout << "\n " << row.group << "\n";
    group = row.group;
    std::cout << line_of(row);
  }
  std::cout << "\n  -h, --help                 this list\n";
  if (!all)
    std::cout << "\n'" << options.command() << " --help=all' lists all "
              << std::ranges::count_if(options.rows(), is_option) << " options.\n";
}

void print_commands(const Command& group, const std::string& path, std::ostream& out) {
  out << group.description << "\nUsage: " << path << " COMMAND [ARGUMENTS]\n\n";
  for (const Command& command : group.below)
    out << "  " << std::left << std::setw(12) << command.name << command.summary << "\n";
  out << "\n'" << path << " COMMAND --help' explains one command, with examples.\n";
}

int run_one(const Command& command, const std::string& path, const Arguments& arguments) {
  Options options(path);
  const Action action = command.declare(options);
  using Parsed = Options::Parsed;
  const Parsed parsed = options.parse(arguments);
  if (parsed == Parsed::kRun) return action();
  if (parsed != Parsed::kList) print_help(command, options, parsed == Parsed::kHelpAll);
  return kOk;
}

/// Ends the process before the exit handlers of libraries, because OpenBLAS's may wait forever for
/// threads that wait for memory (`ulimit -v`).
[[maybe_unused]] void end_at_once(int code, void* /*unused*/) {
  std::fflush(nullptr);
  std::_Exit(code);
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

std::string wrapped(const std::string& text, size_t indent, size_t used) {
  std::string result;
  std::istringstream words(text);
  bool is_first = true;
  for (std::string word; words >> word; is_first = false) {
    if (!is_first && used + 1 + word.size() > kColumns) {
      result += "\n" + std::string(indent, ' ');
      used = indent;
    } else if (!is_first) {
      result += " ";
      ++used;
    }
    result += word;
    used += word.size();
  }
  return result + "\n";
}

int run(const Command& command, const std::string& path, const Arguments& arguments) {
  if (command.declare) return run_one(command, path, arguments);
  if (arguments.empty()) {
    print_commands(command, path, std::cerr);
    return kUsage;
  }
  Arguments rest(arguments.begin() + 1, arguments.end());
  if (arguments[0] == "help" && !rest.empty()) {
    rest.push_back("--help");
    return run(command, path, rest);
  }
  const std::string help[] = {"help", "-h", "--help", "--help=all"};
  if (std::ranges::count(help, arguments[0]) > 0) {
    print_commands(command, path, std::cout);
    return kOk;
  }
  std::vector<std::string> names;
  for (const Command& below : command.below) {
    if (below.name == arguments[0]) return run(below, path + " " + below.name, rest);
    names.push_back(below.name);
  }
  throw UsageError("unknown command '", path, " ", arguments[0], "'",
                   nearest_name_hint(arguments[0], names), "; '", path, " --help' lists them");
}

void for_each_command(
    const Command& command, const std::string& path,
    const std::function<void(const Command& command, const Options& options)>& use) {
  Options options(path);
  if (command.declare) command.declare(options);
  use(command, options);
  for (const Command& below : command.below) for_each_command(below, path + " " + below.name, use);
}

int run_main(const std::string& program, int argc, char** argv,
             const std::function<int(const Arguments&)>& run) {
#ifndef __SANITIZE_ADDRESS__  // it checks for leaks at exit
  on_exit(end_at_once, nullptr);
#endif
  watch_for_interrupt();
  std::signal(SIGXFSZ, SIG_IGN);  // a file beyond `ulimit -f` becomes a write error
  // Names from files must not send commands to the terminal.
  const PrintableStream messages(std::cerr);
  std::optional<PrintableStream> output;
  if (isatty(STDOUT_FILENO)) output.emplace(std::cout);
  const auto fail = [&](const std::string& message, int code) {
    std::cerr << program << ": " << message << "\n";
    return code;
  };
  try {
    const int code = run({argv + 1, argv + argc});
    std::cout.flush();
    return std::cout ? code : fail("cannot write to standard output", kFailed);
  } catch (const UsageError& error) {
    return fail(error.what(), kUsage);
  } catch (const InputError& error) {
    return fail(error.what(), kBadInput);
  } catch (const UnsupportedError& error) {
    return fail(error.what(), kUnsupported);
  } catch (const Interrupted& error) {
    return fail(error.what(), kInterrupted);
  } catch (const std::bad_alloc&) {
    return fail("out of memory; give a smaller input or fewer threads", kFailed);
  } catch (const std::exception& error) {
    return fail(error.what(), kFailed);
  }
}

}  // namespace revisit::cli
