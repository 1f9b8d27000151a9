#include "help/completion.h"
#include "revisit/base/error.h"
#include "revisit/base/joined.h"

namespace revisit::help {
namespace {

using cli::CommandLine;
using cli::Paths;
using cli::Values;

/// As one word of fish.
std::string fish_word(const std::string& text) {
  std::string word = "'";
  for (const char c : text) {
    if (c == '\'' || c == '\\') word += '\\';
    word += c;
  }
  return word + "'";
}

std::string start(const CommandLine& line) {
  return "complete -c revisit -n " + fish_word("__revisit_is " + fish_word(line.command));
}

/// The options of `complete` that say what may stand there. Files are what fish gives by itself.
std::string choices(const Values& values) {
  std::string words = joined(values.words, " ");
  if (values.paths == Paths::kFolders)
    words += (words.empty() ? "" : " ") + std::string("(__fish_complete_directories)");
  const std::string files = values.paths == Paths::kFiles ? " -F" : " -f";
  return files + (words.empty() ? "" : " -a " + fish_word(words));
}

std::string option_line(const CommandLine& line, const CommandLine::Option& option) {
  std::string text = start(line) + " -l " + option.name;
  if (option.letter) text += std::string(" -s ") + fish_word(std::string(1, option.letter));
  if (option.value) text += " -r" + choices(*option.value);
  return text + " -d " + fish_word(brief(option.help)) + "\n";
}

/// fish is told the words of all arguments at once; the number of an argument it does not know.
std::string argument_lines(const CommandLine& line) {
  std::string lines;
  bool paths = false;
  for (const CommandLine::Argument& argument : line.arguments) {
    paths |= argument.value.paths != Paths::kNone;
    if (!argument.value.words.empty())
      lines += start(line) + " -a " + fish_word(joined(argument.value.words, " ")) + "\n";
  }
  if (!paths) lines += start(line) + " -f\n";
  return lines;
}

}  // namespace

std::string fish_completion(const CommandLine& program) {
  std::string commands, rules;
  for (const CommandLine& line : cli::all_of(program)) {
    if (line.command != program.command) commands += str(" ", fish_word(line.command));
    for (const CommandLine& below : line.below)
      rules += start(line) + " -a " + fish_word(below.verb()) + " -d " + fish_word(below.headline) +
               "\n";
    rules += argument_lines(line);
    for (const CommandLine::Option& option : line.options()) rules += option_line(line, option);
  }
  return script_head("fish") + R"~fish~(
# Whether the words before the cursor name this command: 'revisit net inspect'.
function __revisit_is
    set -l at revisit
    set -l words (commandline -opc)
    set -e words[1]
    for word in $words
        if contains -- "$at $word")~fish~" +
         commands + R"~fish~(
            set at "$at $word"
        end
    end
    test "$at" = "$argv[1]"
end

)~fish~" +
         rules;
}

}  // namespace revisit::help
