#include "help/completion.h"
#include "revisit/base/error.h"
#include "revisit/base/joined.h"

namespace revisit::help {
namespace {

using cli::CommandLine;
using cli::Paths;
using cli::Values;

constexpr const char* kHead = R"~zsh~(
# Words, or else paths: PATHS WORD...
_revisit_either() {
  local paths=$1
  shift
  _alternative "words:word:($*)" "paths:path:$paths"
}
)~zsh~";

/// `text` with a backslash before what _arguments takes for the end of a piece.
std::string escaped(const std::string& text) {
  std::string result;
  for (const char c : text) {
    if (c == '[' || c == ']' || c == ':' || c == '\\') result += '\\';
    result += c;
  }
  return result;
}

/// ":NAME:ACTION" of a value.
std::string message_and_action(const Values& values) {
  const std::string paths = values.paths == Paths::kFiles     ? "_files"
                            : values.paths == Paths::kFolders ? "_files -/"
                                                              : "";
  const std::string words = joined(values.words, " ");
  std::string action = " ";  // nothing is known: only the name is shown
  if (!words.empty() && !paths.empty())
    action = " _revisit_either " + (paths == "_files" ? paths : "'" + paths + "'") + " " + words;
  else if (!words.empty())
    action = "(" + words + ")";
  else if (!paths.empty())
    action = paths;
  return str(":", escaped(values.name), ":", action);
}

std::string option_lines(const CommandLine::Option& option) {
  const std::string rest = str("[", escaped(brief(option.help)), "]",
                               option.value ? message_and_action(*option.value) : "");
  const std::string name = "--" + option.name + (option.value ? "=" : "");
  if (!option.letter)
    return str("    ", quoted((option.repeatable ? "*" : "") + name + rest), "\n");
  const std::string letter = std::string("-") + option.letter + (option.value ? "+" : "");
  const std::string others =
      option.repeatable ? "*" : str("(--", option.name, " -", option.letter, ")");
  return str("    ", quoted(others + letter + rest), "\n    ", quoted(others + name + rest), "\n");
}

std::string argument_line(const CommandLine::Argument& argument, size_t number) {
  const std::string place = argument.repeated ? "*" : str(number, argument.required ? "" : ":");
  return str("    ", quoted(place + message_and_action(argument.value)), "\n");
}

/// The function of one command; of one with subcommands it goes on to theirs.
std::string function_of(const CommandLine& line) {
  std::string arguments;
  for (const CommandLine::Option& option : line.options()) arguments += option_lines(option);
  for (size_t i = 0; i < line.arguments.size(); ++i)
    arguments += argument_line(line.arguments[i], i + 1);
  const std::string name = str("_", identifier(line.command));
  if (line.below.empty())
    return str("\n", name, "() {\n  local -a arguments=(\n", arguments,
               "  )\n  _arguments -s -S \"$arguments[@]\"\n}\n");
  std::string commands, cases;
  for (const CommandLine& below : line.below) {
    commands += str("    ", quoted(below.verb() + ":" + below.headline), "\n");
    cases += str("        ", below.verb(), ") _", identifier(below.command), " ;;\n");
  }
  return str("\n", name, "() {\n  local curcontext=$curcontext state\n  local -a commands=(\n",
             commands, "  )\n  local -a arguments=(\n", arguments,
             "    '1:command:->command'\n    '*::argument:->argument'\n  )\n"
             "  _arguments -C \"$arguments[@]\"\n  case $state in\n"
             "    command) _describe command commands ;;\n    argument)\n"
             "      case $words[1] in\n",
             cases, "      esac\n      ;;\n  esac\n}\n");
}

}  // namespace

std::string zsh_completion(const CommandLine& program) {
  std::string functions;
  for (const CommandLine& line : cli::all_of(program)) functions += function_of(line);
  const std::string name = str("_", identifier(program.command));
  // As a file of fpath it is the body of the function; otherwise, by source, it says whose it is.
  return "#compdef " + program.command + "\n" + script_head("zsh") + kHead + functions +
         "\nif [[ $funcstack[1] == " + name + " ]]; then\n  " + name + " \"$@\"\nelse\n  compdef " +
         name + " " + program.command + "\nfi\n";
}

}  // namespace revisit::help
