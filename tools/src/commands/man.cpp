#include <iostream>

#include "cli/command.h"
#include "cli/parser.h"
#include "help/man_page.h"
#include "help/whole_program.h"
#include "revisit/base/atomic_file.h"
#include "revisit/base/folder.h"

namespace revisit::cli {

namespace fs = std::filesystem;

int man_command(const Arguments& arguments) {
  std::vector<std::string> words;
  std::optional<fs::path> folder;
  Parser parser("revisit man", "[COMMAND...]",
                "Prints the manual page of a command, or of revisit itself, as roff; or writes "
                "those of all commands into a folder. Packages install them.",
                "  revisit man net inspect | man -l -\n"
                "  revisit man --all ~/.local/share/man/man1\n");
  parser.optional_positional("COMMAND", &words)
      .option("all", "DIR", "write the pages of all commands there", &folder);
  parser.parse(arguments);
  if (folder && !words.empty()) throw UsageError("--all: leave out the command");

  const CommandLine program = help::whole_program();
  const std::vector<CommandLine> lines = all_of(program);
  if (folder) {
    make_folder(*folder);
    for (const CommandLine& line : lines)
      write_atomically(*folder / help::man_page_file(line),
                       [&](std::ostream& out) { out << help::man_page(line, program); });
    return kOk;
  }
  std::string command = program.command;
  for (const std::string& word : words) command += " " + word;
  for (const CommandLine& line : lines)
    if (line.command == command) {
      std::cout << help::man_page(line, program);
      return kOk;
    }
  throw UsageError(str("there is no command '", command, "'; 'revisit --help' lists them"));
}

}  // namespace revisit::cli
