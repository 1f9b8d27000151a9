#pragma once

#include <optional>
#include <string>
#include <vector>

#include "cli/command.h"

namespace revisit::cli {

/// Which paths may stand where a value is asked for; files come with the folders they are in.
enum class Paths { kNone, kFolders, kFiles };

/// What may stand where a value is asked for, as far as it is known.
struct Values {
  std::string name;                // as --help writes it: "FILE", "table|json"
  std::vector<std::string> words;  // "table", "json"
  Paths paths = Paths::kNone;
};

/// What a command takes, as data: shell completion and manual pages are written from it.
struct CommandLine {
  struct Option {
    std::string name;  // without dashes
    char letter = 0;   // 0: none
    std::string help;
    std::optional<Values> value;  // none: a switch
    bool repeatable = false;
  };
  struct Group {
    std::string heading;  // "" for the first
    std::vector<Option> options;
  };
  struct Argument {
    Values value;
    bool required = false, repeated = false;
  };

  std::string command;   // "revisit net inspect"
  std::string headline;  // one line, as the list of commands has it
  std::string usage;     // "PROTOTXT [WEIGHTS]"
  std::string summary;   // what it does; paragraphs are parted by empty lines
  std::string examples;  // lines as --help has them
  std::vector<Group> groups;
  std::vector<Argument> arguments;
  std::vector<CommandLine> below;  // subcommands; a command with any has no arguments

  /// The last word of `command`.
  std::string verb() const;
  /// The options of all groups, in order.
  std::vector<Option> options() const;
};

/// What `run` takes; it does nothing else. Its `headline` is empty.
CommandLine describe(int (*run)(const Arguments&));

/// `line` and all that is below it, each before what is below it.
std::vector<CommandLine> all_of(const CommandLine& line);

/// The words and paths that the name of a value speaks of: "K|all|none" has the words all and none,
/// and `DIR` stands for a folder. `is_path`: its type says that it is one.
Values values_named(const std::string& name, bool is_path);

/// Whether a command is asked to describe itself instead of running: nothing that a user can type.
bool asks_for_description(const Arguments& arguments);

/// How a command answers that: the caller catches it.
struct Described {
  CommandLine line;
};

}  // namespace revisit::cli
