#include <iostream>

#include "cli/command_line.h"
#include "cli/parser.h"
#include "cli/shell.h"
#include "revisit/base/files.h"

namespace revisit::cli {
namespace {

/// Walks over the words before the cursor. bash splits --map=x into three words and replaces only
/// the last; zsh by bashcompinit does neither, and reserves the names `commands` and `options`.
constexpr const char* kWalk = R"~bash~(
_revisit() {
  local -a line=()
  local i piece before='' raw=${COMP_WORDS[COMP_CWORD]}
  for ((i = 1; i <= COMP_CWORD; i++)); do
    piece=${COMP_WORDS[i]}
    if ((${#line[@]})) && [[ $piece == [=:]* || $before == [=:]* ]]; then
      line[${#line[@]}-1]+=$piece
    else
      line+=("$piece")
    fi
    before=$piece
  done
  [[ $raw == [=:]* ]] && raw=''

  local at=revisit asking='' only_arguments='' argument=1 word
  local below known_options asking_options values paths
  _revisit_command "$at"
  for word in "${line[@]:0:${#line[@]}-1}"; do
    if [[ -n $asking ]]; then
      asking=''
    elif [[ -z $only_arguments && $word == -- ]]; then
      only_arguments=yes
    elif [[ -z $only_arguments && $word == -?* ]]; then
      [[ " $asking_options " == *" $word "* ]] && asking=$word
    elif [[ -n $below && $word == help && $argument == 1 ]]; then
      :
    elif [[ -n $below && " $below " == *" $word "* ]]; then
      at+=" $word"
      _revisit_command "$at"
    else
      ((argument++))
    fi
  done

  local current=${line[${#line[@]}-1]} typed option=''
  typed=$current
  if [[ -z $asking && -z $only_arguments && $current == --*=* ]]; then
    asking=${current%%=*}
    typed=${current#*=}
    [[ $raw == --*=* ]] && option=$asking= raw=${raw#*=}
  fi
  values='' paths=''
  if [[ -z $asking && -z $only_arguments && $current == -?* ]]; then
    values=$known_options
  elif [[ -n $asking ]]; then
    _revisit_value "$at $asking"
  elif [[ -n $below && $argument == 1 ]]; then
    values=$below
  else
    _revisit_value "$at $argument"
    [[ -z $values$paths && -z $typed ]] && values=$known_options
  fi
  typed=${typed//\\/} raw=${raw//\\/}  # what a quoted name is without its quotes
  local kept=${typed%"$raw"}
  COMPREPLY=()
  while IFS= read -r word; do
    [[ -n $word ]] && COMPREPLY+=("$option${word#"$kept"}")
  done < <(
    compgen -W "$values" -- "$typed"
    case $paths in
      files) compgen -f -- "$typed" ;;
      folders) compgen -d -- "$typed" ;;
    esac
  )
  [[ -n $paths ]] && compopt -o filenames 2>/dev/null  # a slash behind a folder
  return 0
}
complete -F _revisit revisit
)~bash~";

std::vector<std::string> spellings(const CommandLine::Option& option) {
  std::vector<std::string> all{"--" + option.name};
  if (option.letter) all.push_back(std::string("-") + option.letter);
  return all;
}

std::string variable(const std::string& name, const std::vector<std::string>& words) {
  return words.empty() ? "" : str(" ", name, "=", shell_word(joined(words, " ")));
}

std::string command_case(const CommandLine& line) {
  std::vector<std::string> below, options, asking;
  for (const CommandLine& command : line.below) below.push_back(command.verb());
  for (const CommandLine::Option& option : line.options) {
    options.push_back("--" + option.name);
    for (const std::string& spelling : spellings(option))
      if (option.value) asking.push_back(spelling);
  }
  return str("    ", shell_word(line.command), ")", variable("below", below),
             variable("known_options", options), variable("asking_options", asking), " ;;\n");
}

std::string value_case(const std::string& pattern, const Values& values) {
  std::string sets = variable("values", values.words);
  if (values.paths != Paths::kNone)
    sets += values.paths == Paths::kFiles ? " paths=files" : " paths=folders";
  return sets.empty() ? "" : str("    ", pattern, ")", sets, " ;;\n");
}

std::string value_cases(const CommandLine& line) {
  std::string cases;
  for (const CommandLine::Option& option : line.options) {
    if (!option.value) continue;
    const std::string pattern = joined(spellings(option), " | ", [&](const std::string& spelling) {
      return shell_word(line.command + " " + spelling);
    });
    cases += value_case(pattern, *option.value);
  }
  for (size_t i = 0; i < line.arguments.size(); ++i) {
    const CommandLine::Argument& argument = line.arguments[i];
    const std::string pattern = argument.repeated ? shell_word(line.command + " ") + "[0-9]*"
                                                  : shell_word(str(line.command, " ", i + 1));
    cases += value_case(pattern, argument.value);
  }
  return cases;
}

std::string bash_completion() {
  CommandLine program = describe(revisit_command);
  program.options.push_back({"version", 0, {}});
  std::string commands, values;
  for (const CommandLine& line : all_of(program)) {
    commands += command_case(line);
    values += value_cases(line);
  }
  return str("# Completion of `revisit` ", REVISIT_VERSION,
             " for bash, written by `revisit completion bash`.\n\n"
             "# COMMAND: its subcommands, its options, and its options with a value.\n"
             "_revisit_command() {\n  below='' known_options='' asking_options=''\n  case $1 in\n",
             commands,
             "  esac\n}\n\n# COMMAND OPTION or COMMAND N (its Nth argument): possible values.\n"
             "_revisit_value() {\n  case $1 in\n",
             values, "  esac\n}\n", kWalk);
}

}  // namespace

int completion_command(const Arguments& arguments) {
  std::string shell;
  std::filesystem::path output;
  Parser parser("revisit completion", "bash",
                "Prints a script that completes commands, options and values of `revisit` in bash, "
                "and in zsh by "
                "bashcompinit. Packages install it; source it for a program that you built.",
                "  source <(revisit completion bash)\n"
                "  autoload -U compinit bashcompinit && compinit && bashcompinit    # first, in "
                "zsh\n");
  parser.positional("SHELL", &shell).suggest({"bash"});
  parser.option("output", "FILE", "file of the script (default: standard output)", &output, 'o');
  parser.parse(arguments);
  if (shell != "bash")
    throw UsageError("SHELL: expected bash, found '", shell, "'; zsh can load it by bashcompinit");
  const std::string script = bash_completion();
  if (output.empty())
    std::cout << script;
  else
    write_atomically(output, [&](std::ostream& out) { out << script; });
  return kOk;
}

}  // namespace revisit::cli
