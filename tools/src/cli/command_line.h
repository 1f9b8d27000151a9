#pragma once

#include <optional>
#include <string>
#include <vector>

#include "cli/command.h"

namespace revisit::cli {

/// Paths that are possible values; kFiles includes the folders on the way.
enum class Paths { kNone, kFolders, kFiles };

struct Values {
  std::vector<std::string> words;
  Paths paths = Paths::kNone;
};

struct CommandLine {
  struct Option {
    std::string name;             // without dashes
    char letter = 0;              // 0: none
    std::optional<Values> value;  // absent: a flag
  };
  struct Argument {
    Values value;
    bool repeated = false;
  };

  std::string command;  // "revisit net inspect"
  std::vector<Option> options;
  std::vector<Argument> arguments;
  std::vector<CommandLine> below;  // subcommands; such a command has no arguments

  std::string verb() const;
};

CommandLine describe(int (*run)(const Arguments&));

/// `line` and all commands below it, parents first.
std::vector<CommandLine> all_of(const CommandLine& line);

/// Values by a metavar: words of "K|all|none" in lower case; folders for DIR; files for FILE or
/// `is_path`.
Values values_named(const std::string& name, bool is_path);

/// True if the command must throw Described instead of running. No user can type such arguments.
bool asks_for_description(const Arguments& arguments);
struct Described {
  CommandLine line;
};

}  // namespace revisit::cli
