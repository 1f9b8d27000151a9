#include "help/completion.h"

#include <algorithm>
#include <iostream>

#include "cli/command.h"
#include "cli/parser.h"
#include "help/whole_program.h"
#include "revisit/base/atomic_file.h"

namespace revisit::cli {
namespace {

namespace fs = std::filesystem;

struct Shell {
  const char* name;
  std::string (*completion)(const CommandLine& program);
};
constexpr Shell kShells[] = {{"bash", help::bash_completion},
                             {"zsh", help::zsh_completion},
                             {"fish", help::fish_completion}};

}  // namespace

int completion_command(const Arguments& arguments) {
  std::string shell;
  fs::path output;
  Parser parser("revisit completion", "bash|zsh|fish",
                "Prints a script that completes the commands, options and values of `revisit` in "
                "a shell. Packages install them; for a program of your own build, source it.",
                "  source <(revisit completion bash)\n"
                "  revisit completion fish > ~/.config/fish/completions/revisit.fish\n");
  parser.positional("SHELL", &shell).suggest({"bash", "zsh", "fish"});
  parser.option("output", "FILE", "where it goes (default: standard output)", &output, 'o');
  parser.parse(arguments);
  const auto writer = std::ranges::find(kShells, shell, &Shell::name);
  if (writer == std::end(kShells))
    throw UsageError(str("expected bash, zsh or fish, found '", shell, "'"));
  const std::string script = writer->completion(help::whole_program());
  if (output.empty())
    std::cout << script;
  else
    write_atomically(output, [&](std::ostream& out) { out << script; });
  return kOk;
}

}  // namespace revisit::cli
