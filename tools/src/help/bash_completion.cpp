#include <set>

#include "help/completion.h"
#include "revisit/base/error.h"
#include "revisit/base/joined.h"

namespace revisit::help {
namespace {

using cli::CommandLine;
using cli::Paths;
using cli::Values;

/// The walk over the words before the cursor. bash takes --map=x apart into three words; what it
/// puts in the place of the last one is only what comes after the sign.
constexpr const char* kWalk = R"~bash~(
_revisit() {
  local -a words=()
  local i piece before='' raw=${COMP_WORDS[COMP_CWORD]}
  for ((i = 1; i <= COMP_CWORD; i++)); do
    piece=${COMP_WORDS[i]}
    if ((${#words[@]})) && [[ $piece == [=:]* || $before == [=:]* ]]; then
      words[-1]+=$piece
    else
      words+=("$piece")
    fi
    before=$piece
  done
  [[ $raw == [=:]* ]] && raw=''

  local at=revisit asking='' only_arguments='' argument=1 word
  local commands options asking_options values paths
  _revisit_command "$at"
  for word in "${words[@]:0:${#words[@]}-1}"; do
    if [[ -n $asking ]]; then
      asking=''
    elif [[ -z $only_arguments && $word == -- ]]; then
      only_arguments=yes
    elif [[ -z $only_arguments && $word == -?* ]]; then
      [[ " $asking_options " == *" $word "* ]] && asking=$word
    elif [[ -n $commands && $word == help && $argument == 1 ]]; then
      :
    elif [[ -n $commands && " $commands " == *" $word "* ]]; then
      at+=" $word"
      _revisit_command "$at"
    else
      ((argument++))
    fi
  done

  local current=${words[-1]} typed
  typed=$current
  COMPREPLY=()
  if [[ -z $asking && -z $only_arguments && $current == --*=* ]]; then
    asking=${current%%=*}
    typed=${current#*=}
  fi
  if [[ -z $asking && -z $only_arguments && $current == -* && $current != - ]]; then
    mapfile -t COMPREPLY < <(compgen -W "$options" -- "$current")
    return
  fi
  typed=${typed//\\/} raw=${raw//\\/}  # what a quoted name is without its quotes
  values='' paths=''
  if [[ -n $asking ]]; then
    _revisit_value "$at $asking"
  elif [[ -n $commands && $argument == 1 ]]; then
    values=$commands
  else
    _revisit_value "$at $argument"
    [[ -z $values$paths && -z $typed ]] && values=$options
  fi
  mapfile -t COMPREPLY < <(
    compgen -W "$values" -- "$typed"
    case $paths in
      files) compgen -f -- "$typed" ;;
      folders) compgen -d -- "$typed" ;;
    esac
  )
  [[ -n $paths ]] && compopt -o filenames 2>/dev/null  # a slash behind a folder
  local kept=${typed%"$raw"}
  for i in "${!COMPREPLY[@]}"; do
    COMPREPLY[i]=${COMPREPLY[i]#"$kept"}
  done
}
complete -F _revisit revisit
)~bash~";

/// "--output" and "-o", or what there is of them.
std::vector<std::string> spellings(const CommandLine::Option& option) {
  std::vector<std::string> all{"--" + option.name};
  if (option.letter) all.push_back(std::string("-") + option.letter);
  return all;
}

std::string variable(const std::string& name, const std::vector<std::string>& words) {
  return words.empty() ? "" : str(" ", name, "=", quoted(joined(words, " ")));
}

std::string command_case(const CommandLine& line) {
  std::vector<std::string> commands, options, asking;
  for (const CommandLine& below : line.below) commands.push_back(below.verb());
  for (const CommandLine::Option& option : line.options()) {
    options.push_back("--" + option.name);
    for (const std::string& spelling : spellings(option))
      if (option.value) asking.push_back(spelling);
  }
  return str("    ", quoted(line.command), ")", variable("commands", commands),
             variable("options", options), variable("asking_options", asking), " ;;\n");
}

std::string value_case(const std::string& pattern, const Values& values) {
  std::string sets = variable("values", values.words);
  if (values.paths != Paths::kNone)
    sets += values.paths == Paths::kFiles ? " paths=files" : " paths=folders";
  return sets.empty() ? "" : str("    ", pattern, ")", sets, " ;;\n");
}

std::string value_cases(const CommandLine& line) {
  std::string cases;
  for (const CommandLine::Option& option : line.options()) {
    if (!option.value) continue;
    const std::string pattern = joined(spellings(option), " | ", [&](const std::string& spelling) {
      return quoted(line.command + " " + spelling);
    });
    cases += value_case(pattern, *option.value);
  }
  for (size_t i = 0; i < line.arguments.size(); ++i) {
    const CommandLine::Argument& argument = line.arguments[i];
    const std::string pattern = argument.repeated ? quoted(line.command + " ") + "[0-9]*"
                                                  : quoted(str(line.command, " ", i + 1));
    cases += value_case(pattern, argument.value);
  }
  return cases;
}

}  // namespace

std::string bash_completion(const CommandLine& program) {
  std::string commands, values;
  for (const CommandLine& line : cli::all_of(program)) {
    commands += command_case(line);
    values += value_cases(line);
  }
  return script_head("bash") +
         "\n# COMMAND: its subcommands, its options, and those of them that ask for a value.\n"
         "_revisit_command() {\n  commands='' options='' asking_options=''\n  case $1 in\n" +
         commands +
         "  esac\n}\n\n# COMMAND OPTION or COMMAND N, its Nth argument: what may stand there.\n"
         "_revisit_value() {\n  case $1 in\n" +
         values + "  esac\n}\n" + kWalk;
}

}  // namespace revisit::help
