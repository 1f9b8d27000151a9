#pragma once

#include <optional>
#include <string>
#include <vector>

#include "cli/command.h"

namespace revisit::cli {

/// Which paths may stand where a value is asked for; files come with the folders they are in.
enum class Paths { kNone, kFolders, kFiles };

/// Known values of an option or argument.
struct Values {
  std::vector<std::string> words;  // "table", "json"
  Paths paths = Paths::kNone;
};

/// Options, arguments and subcommands of a command, from which shell completion is written.
struct CommandLine {
  struct Option {
    std::string name;             // without dashes
    char letter = 0;              // 0: none
    std::optional<Values> value;  // none: a switch
  };
  struct Argument {
    Values value;
    bool repeated = false;
  };

  std::string command;  // "revisit net inspect"
  std::vector<Option> options;
  std::vector<Argument> arguments;
  std::vector<CommandLine> below;  // subcommands; a command with any has no arguments

  std::string verb() const;  // the last word of `command`
};

CommandLine describe(int (*run)(const Arguments&));

/// `line` and all that is below it, each before what is below it.
std::vector<CommandLine> all_of(const CommandLine& line);

/// "K|all|none" has the words all and none, `DIR` is a folder, `FILE` or `is_path` a file.
Values values_named(const std::string& name, bool is_path);

/// Whether a command is to throw Described instead of running: nothing that a user can type.
bool asks_for_description(const Arguments& arguments);
struct Described {
  CommandLine line;
};

}  // namespace revisit::cli
