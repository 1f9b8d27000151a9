#include "command.h"

#include <iomanip>
#include <iostream>

#include "revisit/proto/error.h"

namespace revisit::cli {

int dispatch(const std::string& program, const char* introduction,
             const std::vector<Command>& table, const Arguments& arguments) {
  if (arguments.size() > 1 && arguments[0] == "help") {  // as `COMMAND ... --help`
    Arguments asked(arguments.begin() + 1, arguments.end());
    asked.push_back("--help");
    return dispatch(program, introduction, table, asked);
  }
  if (arguments.empty() || arguments[0] == "--help" || arguments[0] == "-h" ||
      arguments[0] == "help") {
    std::ostream& out = arguments.empty() ? std::cerr : std::cout;
    out << introduction << "\nUsage: " << program << " COMMAND [ARGUMENTS]\n\n";
    for (const Command& command : table)
      out << "  " << std::left << std::setw(12) << command.name << command.summary << "\n";
    out << "\n'" << program << " COMMAND --help' explains one command, with examples.\n";
    return arguments.empty() ? kUsage : kOk;
  }
  std::vector<std::string> names;
  for (const Command& command : table) {
    if (arguments[0] == command.name) return command.run({arguments.begin() + 1, arguments.end()});
    names.emplace_back(command.name);
  }
  throw UsageError(str("unknown command '", program, " ", arguments[0], "'",
                       did_you_mean(arguments[0], names), "; '", program, " --help' lists them"));
}

}  // namespace revisit::cli
