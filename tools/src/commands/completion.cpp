#include "cli/command.h"
#include "cli/shell.h"

namespace revisit::cli {
namespace {

/// Walks over the words before the cursor. bash splits --map=x into three words and replaces only
/// the last; zsh by bashcompinit does neither, and reserves the names `commands` and `options`.
constexpr const char* kWalk = R"~bash~(
# The options of `revisit simulate`, a program of its own, are in its help. With OPTION: its possible values.
_revisit_simulate() {
  local name letter metavar
  while read -r name letter metavar; do
    letter=${letter%,-}
    known_options+=" $name"
    [[ -n $metavar ]] && asking_options+=" $name $letter"
    [[ ${1:-} == "$name" || ${1:-} == "$letter" ]] || continue
    case $metavar in
      DIR) paths=folders ;;
      FILE) paths=files ;;
      *[A-Z]*) ;;
      *) values=${metavar//|/ } ;;
    esac
  done < <(revisit simulate --help=all 2>/dev/null | sed -En 's/^  (-.,|   ) (--[a-z-]+)=?([^ ]*).*/\2 \1- \3/p')
}

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
      [[ $at == 'revisit simulate' ]] && _revisit_simulate
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
    [[ $at == 'revisit simulate' ]] && _revisit_simulate "$asking"
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

std::vector<std::string> spellings(const Row& row) {
  std::vector<std::string> all{row.spelled()};
  if (row.letter) all.push_back(std::string("-") + row.letter);
  return all;
}

std::string variable(const std::string& name, const std::vector<std::string>& words) {
  return words.empty() ? "" : str(" ", name, "=", shell_word(joined(words, " ")));
}

std::string command_case(const Command& command, const Options& options) {
  std::vector<std::string> below, known, asking;
  for (const Command& one : command.below) below.push_back(one.name);
  for (const Row& row : options.rows()) {
    if (row.is_argument) continue;
    known.push_back(row.spelled());
    for (const std::string& spelling : spellings(row))
      if (!row.is_flag()) asking.push_back(spelling);
  }
  if (options.command() == "revisit") known.push_back("--version");
  known.push_back("--help");
  return str("    ", shell_word(options.command()), ")", variable("below", below),
             variable("known_options", known), variable("asking_options", asking), " ;;\n");
}

std::string value_case(const std::string& pattern, const Row& row) {
  std::string sets = variable("values", row.possible_words());
  if (const Paths paths = row.possible_paths(); paths != Paths::kNone)
    sets += paths == Paths::kFiles ? " paths=files" : " paths=folders";
  return sets.empty() ? "" : str("    ", pattern, ")", sets, " ;;\n");
}

std::string value_cases(const Options& options) {
  std::string cases;
  int arguments = 0;
  for (const Row& row : options.rows()) {
    std::string pattern;
    if (row.is_flag()) continue;
    if (!row.is_argument)
      pattern = joined(spellings(row), " | ", [&](const std::string& spelling) {
        return shell_word(options.command() + " " + spelling);
      });
    else if (row.is_repeatable())
      pattern = shell_word(options.command() + " ") + "[0-9]*";
    else
      pattern = shell_word(str(options.command(), " ", ++arguments));
    cases += value_case(pattern, row);
  }
  return cases;
}

}  // namespace

std::string bash_completion() {
  std::string commands, values;
  for_each_command(revisit_program(), "revisit",
                   [&](const Command& command, const Options& options) {
                     commands += command_case(command, options);
                     values += value_cases(options);
                   });
  return str("# Completion of `revisit` ", REVISIT_VERSION,
             " for bash, written by `revisit --completion`.\n\n"
             "# COMMAND: its subcommands, its options, and its options with a value.\n"
             "_revisit_command() {\n  below='' known_options='' asking_options=''\n  case $1 in\n",
             commands,
             "  esac\n}\n\n# COMMAND OPTION or COMMAND N (its Nth argument): possible values.\n"
             "_revisit_value() {\n  case $1 in\n",
             values, "  esac\n}\n", kWalk);
}

}  // namespace revisit::cli
