#include "help/man_page.h"

#include <algorithm>
#include <sstream>
#include <vector>

#include "revisit/base/error.h"

namespace revisit::help {
namespace {

using cli::CommandLine;

/// `text` so that roff prints it as it is. roff makes typographic signs of these characters, which
/// nobody could paste into a shell; a point or a quote that begins a line would be a request.
std::string plain(const std::string& text) {
  std::string result;
  for (const char c : text) {
    if (result.empty() && (c == '.' || c == '\'')) result += "\\&";
    if (c == '\\')
      result += "\\e";
    else if (c == '-')
      result += "\\-";
    else if (c == '\'')
      result += "\\(aq";
    else if (c == '`')
      result += "\\(ga";
    else if (c == '^')
      result += "\\(ha";
    else if (c == '~')
      result += "\\(ti";
    else
      result += c;
  }
  return result;
}

std::string bold(const std::string& text) {
  return "\\fB" + plain(text) + "\\fP";
}

std::string italic(const std::string& text) {
  return "\\fI" + plain(text) + "\\fP";
}

/// "revisit-net-inspect": how `man` calls a page.
std::string page_name(const CommandLine& line) {
  std::string name = line.command;
  std::ranges::replace(name, ' ', '-');
  return name;
}

std::string reference(const CommandLine& line) {
  return bold(page_name(line)) + "(1)";
}

/// Lines of text; an empty one parts paragraphs.
std::string paragraphs(const std::string& text) {
  std::string result;
  std::istringstream lines(text);
  for (std::string line; std::getline(lines, line);)
    result += line.empty() ? ".PP\n" : plain(line) + "\n";
  return result;
}

/// Lines that stay as they are.
std::string verbatim(const std::string& text) {
  std::string result = ".PP\n.nf\n";
  std::istringstream lines(text);
  for (std::string line; std::getline(lines, line);) result += plain(line) + "\n";
  return result + ".fi\n";
}

std::string synopsis(const CommandLine& line) {
  const std::string options = line.below.empty() ? " [" + italic("OPTION") + "...]" : "";
  return ".SH SYNOPSIS\n" + bold(line.command) + options + (line.usage.empty() ? "" : " ") +
         plain(line.usage) + "\n";
}

std::string commands(const CommandLine& line) {
  if (line.below.empty()) return "";
  std::string text = ".SH COMMANDS\n";
  for (const CommandLine& below : line.below)
    text += ".TP\n" + reference(below) + "\n" + plain(below.headline) + "\n";
  return text;
}

std::string option(const CommandLine::Option& option) {
  std::string text = ".TP\n";
  if (option.letter) text += bold(std::string("-") + option.letter) + ", ";
  text += bold("--" + option.name);
  if (option.value) text += str("=", italic(option.value->name));
  text += str("\n", plain(option.help));
  if (option.repeatable) text += "\nThe option may be repeated.";
  if (option.value && !option.value->words.empty()) {
    std::string words;
    for (const std::string& word : option.value->words)
      // Those of NAME|list and of table|json are read above.
      if (("|" + option.value->name + "|").find("|" + word + "|") == std::string::npos)
        words += (words.empty() ? "" : ", ") + bold(word);
    if (!words.empty()) text += "\nKnown: " + words + ".";
  }
  return text + "\n";
}

std::string options(const CommandLine& line) {
  std::string text = ".SH OPTIONS\n";
  for (const CommandLine::Group& group : line.groups) {
    if (!group.heading.empty()) text += ".SS " + plain("\"" + group.heading + "\"") + "\n";
    for (const CommandLine::Option& one : group.options) text += option(one);
  }
  return text;
}

/// Of commands with a parser: parser.h.
std::string environment(const CommandLine& line) {
  if (!line.below.empty()) return "";
  return ".SH ENVIRONMENT\nThe variable " + bold("REVISIT_") + italic("OPTION") +
         ", in capitals and with _ for \\-, sets an option that the command line does not: " +
         bold("REVISIT_THREADS") + " sets " + bold("--threads") + ". Only " +
         bold("REVISIT_MODELS") + " is something else, the folder of fetched models.\n";
}

std::string exit_status(const CommandLine& line, const CommandLine& program) {
  if (line.command != program.command) return "";
  std::string text = ".SH EXIT STATUS\n";
  for (const auto& [code, meaning] : cli::exit_codes())
    text += ".TP\n" + bold(std::to_string(static_cast<int>(code))) + "\n" + plain(meaning) + "\n";
  return text;
}

/// The command above, and the one beside a subcommand.
std::string see_also(const CommandLine& line, const CommandLine& program) {
  std::vector<std::string> pages;
  for (const CommandLine& other : cli::all_of(program))
    if (line.command.starts_with(other.command + " ")) pages.push_back(reference(other));
  if (pages.empty()) return "";
  std::string text = ".SH SEE ALSO\n";
  for (size_t i = 0; i < pages.size(); ++i) text += (i ? ",\n" : "") + pages[i];
  return text + "\n";
}

}  // namespace

std::string man_page_file(const CommandLine& line) {
  return page_name(line) + ".1";
}

std::string man_page(const CommandLine& line, const CommandLine& program) {
  std::string title = page_name(line);
  std::ranges::transform(title, title.begin(),
                         [](unsigned char c) { return static_cast<char>(std::toupper(c)); });
  std::string text = str(".TH ", plain(title), " 1 \"\" \"revisit ", REVISIT_VERSION,
                         "\" \"User Commands\"\n.ad l\n.nh\n.SH NAME\n", plain(page_name(line)),
                         " \\- ", plain(line.headline), "\n");
  text += synopsis(line) + ".SH DESCRIPTION\n" + paragraphs(line.summary) + commands(line) +
          options(line);
  if (!line.examples.empty()) text += ".SH EXAMPLES\n" + verbatim(line.examples);
  return text + environment(line) + exit_status(line, program) + see_also(line, program);
}

}  // namespace revisit::help
