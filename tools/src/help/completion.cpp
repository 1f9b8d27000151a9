#include "help/completion.h"

#include <algorithm>
#include <cctype>

#include "revisit/base/error.h"

namespace revisit::help {

std::string brief(const std::string& help) {
  constexpr size_t kMost = 70;
  const std::string dots = " ...";
  if (help.size() <= kMost) return help;
  const size_t end = help.rfind(' ', kMost - dots.size());
  return help.substr(0, end == std::string::npos ? kMost - dots.size() : end) + dots;
}

std::string quoted(const std::string& text) {
  std::string word = "'";
  for (const char c : text) word += c == '\'' ? "'\\''" : std::string(1, c);
  return word + "'";
}

std::string identifier(const std::string& command) {
  std::string name = command;
  std::ranges::replace_if(
      name, [](unsigned char c) { return !std::isalnum(c); }, '_');
  return name;
}

std::string script_head(const std::string& shell) {
  return str("# Completion of `revisit` ", REVISIT_VERSION, " for ", shell,
             ", written by `revisit completion ", shell, "`.\n");
}

}  // namespace revisit::help
