#include "cli/shell.h"

#include <algorithm>
#include <cctype>
#include <string_view>

namespace revisit::cli {

std::string shell_word(const std::string& text) {
  const bool plain = !text.empty() && std::ranges::all_of(text, [](unsigned char c) {
    return std::isalnum(c) ||
           std::string_view("_-./=,:+@%").find(static_cast<char>(c)) != std::string_view::npos;
  });
  if (plain) return text;
  std::string word = "'";
  for (const char c : text) word += c == '\'' ? "'\\''" : std::string(1, c);
  return word + "'";
}

std::string shell_command(const std::string& program, const Arguments& arguments) {
  std::string command = program;
  for (const std::string& argument : arguments) command += " " + shell_word(argument);
  return command;
}

}  // namespace revisit::cli
