#include "cli/command_line.h"

#include <algorithm>
#include <sstream>
#include <stdexcept>

namespace revisit::cli {
namespace {

/// No argument of a process can hold a zero byte.
const std::string kDescribe("\0describe", 9);

bool is_word(const std::string& text) {
  const auto of_words = [](unsigned char c) {
    return (c >= 'a' && c <= 'z') || (c >= '0' && c <= '9') || c == '-' || c == '_' || c == '.';
  };
  return std::ranges::all_of(text, of_words) &&
         std::ranges::any_of(text, [](unsigned char c) { return std::isalnum(c); });
}

}  // namespace

std::string CommandLine::verb() const {
  return command.substr(command.rfind(' ') + 1);
}

CommandLine describe(int (*run)(const Arguments&)) {
  try {
    run({kDescribe});
  } catch (const Described& described) {
    return described.line;
  }
  throw std::logic_error("a command does not describe itself");
}

std::vector<CommandLine> all_of(const CommandLine& line) {
  std::vector<CommandLine> all{line};
  for (const CommandLine& below : line.below) {
    const std::vector<CommandLine> more = all_of(below);
    all.insert(all.end(), more.begin(), more.end());
  }
  return all;
}

Values values_named(const std::string& name, bool is_path) {
  Values values{{}, is_path ? Paths::kFiles : Paths::kNone};
  std::istringstream pieces(name);
  for (std::string piece; std::getline(pieces, piece, '|');) {
    if (is_word(piece)) values.words.push_back(piece);
    if (piece == "DIR") values.paths = Paths::kFolders;
    if (piece == "FILE") values.paths = Paths::kFiles;
  }
  return values;
}

bool asks_for_description(const Arguments& arguments) {
  return arguments.size() == 1 && arguments[0] == kDescribe;
}

}  // namespace revisit::cli
