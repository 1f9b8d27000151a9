#include "parser.h"

#include <argp.h>

#include <algorithm>
#include <charconv>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <limits>
#include <span>
#include <sstream>

#include "cli/messages.h"
#include "cli/renamed.h"

namespace revisit::cli {
namespace {

namespace fs = std::filesystem;

struct Collected {
  std::vector<std::pair<Parser::Option*, std::string>> options;
  std::vector<std::string> positionals;
  std::vector<Parser::Option>* declared = nullptr;
  std::function<void(bool all)> print_help = {};
};

/// Checks the output, because argp ignores one that cannot be written.
[[noreturn]] void end_after_help() {
  if (std::fflush(stdout) == 0 && !std::ferror(stdout)) std::exit(EXIT_SUCCESS);
  std::fputs("revisit: cannot write to standard output\n", stderr);
  std::exit(EXIT_FAILURE);
}

/// argp identifies an option by an integer: its letter, or its index above the range of letters.
constexpr int kHelpKey = '?', kUsageKey = 999, kFirstKey = 1000;

int key_of(const Parser::Option& option, size_t index) {
  return option.letter ? option.letter : kFirstKey + static_cast<int>(index);
}

argp_option argp_option_of(const Parser::Option& option, int key, int group) {
  return {option.name.c_str(),
          key,
          option.metavar.empty() ? nullptr : option.metavar.c_str(),
          option.now.empty() ? 0 : OPTION_HIDDEN,
          option.help.c_str(),
          group};
}

error_t collect(int key, char* argument, argp_state* state) {
  auto& collected = *static_cast<Collected*>(state->input);
  if (key == ARGP_KEY_ARG) {
    collected.positionals.emplace_back(argument);
    return 0;
  }
  if (key == kHelpKey) {
    if (argument && argument != std::string("all"))
      argp_error(state, "--help: expected no value or 'all', found '%s'", argument);
    collected.print_help(argument != nullptr);
    end_after_help();
  }
  if (key == kUsageKey) {
    argp_state_help(state, stdout, ARGP_HELP_USAGE);
    end_after_help();
  }
  for (size_t i = 0; i < collected.declared->size(); ++i) {
    Parser::Option& option = (*collected.declared)[i];
    if (option.is_heading || key != key_of(option, i)) continue;
    collected.options.emplace_back(&option, argument ? argument : "");
    return 0;
  }
  return ARGP_ERR_UNKNOWN;
}

bool is_config(const Parser::Option& option) {
  return option.name == "config";
}

std::string environment_name(const std::string& option) {
  std::string name = "REVISIT_" + option;
  std::transform(name.begin(), name.end(), name.begin(), [](unsigned char c) {
    return c == '-' ? '_' : static_cast<char>(std::toupper(c));
  });
  return name;
}

}  // namespace

std::vector<std::string> comma_separated(const std::string& list) {
  std::vector<std::string> parts;
  std::istringstream in(list);
  for (std::string part; std::getline(in, part, ',');) parts.push_back(part);
  return parts;
}

template <class Number>
Number parse_value(const std::string& what, const std::string& text) {
  Number value{};
  const char* const end = text.data() + text.size();
  const auto [stop, error] = std::from_chars(text.data(), end, value);
  if (error == std::errc::result_out_of_range)
    throw UsageError(what, ": ", text, " is out of range");
  if (error != std::errc() || stop != end)
    throw UsageError(what, ": expected ",
                     std::is_integral_v<Number> ? "a whole number" : "a number", ", found '", text,
                     "'");
  if constexpr (std::is_floating_point_v<Number>)
    if (!std::isfinite(value)) throw UsageError(what, ": ", text, " is not a usable number");
  return value;
}
template int parse_value(const std::string&, const std::string&);
template int64_t parse_value(const std::string&, const std::string&);
template uint64_t parse_value(const std::string&, const std::string&);
template double parse_value(const std::string&, const std::string&);
template <>
std::string parse_value(const std::string&, const std::string& text) {
  return text;
}
template <>
fs::path parse_value(const std::string& what, const std::string& text) {
  if (text.empty()) throw UsageError(what + ": expected a path, found an empty string");
  return text;
}
template <>
uint32_t parse_value(const std::string& what, const std::string& text) {
  const auto value = parse_value<int64_t>(what, text);
  constexpr uint32_t kMost = std::numeric_limits<uint32_t>::max();
  if (value < 0 || value > kMost)
    throw UsageError(what, ": expected 0 to ", kMost, ", found ", value);
  return static_cast<uint32_t>(value);
}
template <>
bool parse_value(const std::string& what, const std::string& text) {
  if (text.empty() || text == "true" || text == "1" || text == "on") return true;
  if (text == "false" || text == "0" || text == "off") return false;
  throw UsageError(what, ": expected true or false, found '", text, "'");
}

Parser::Parser(std::string command, std::string usage, std::string summary, std::string examples)
    : command_(std::move(command)),
      usage_(std::move(usage)),
      summary_(std::move(summary)),
      examples_(std::move(examples)) {}

Parser& Parser::add(Option option) {
  last_is_positional_ = false;
  options_.push_back(std::move(option));
  return *this;
}

Parser& Parser::suggest(const std::vector<std::string>& words) {
  (last_is_positional_ ? positionals_.back().suggested : options_.back().suggested) = words;
  return *this;
}

size_t Parser::index_of_word(const std::string& what, const std::string& text,
                             const std::vector<std::string>& words) {
  const auto found = std::ranges::find(words, text);
  if (found != words.end()) return static_cast<size_t>(found - words.begin());
  const std::span<const std::string> but_last(words.data(), words.size() - 1);
  throw UsageError(what, ": expected ", joined(but_last, ", "), " or ", words.back(), ", found '",
                   text, "'", nearest_name_hint(text, words));
}

Parser& Parser::choice(std::string name, const std::vector<std::string>& words, std::string help,
                       std::string* target) {
  std::vector<std::pair<std::string, std::string>> values;
  for (const std::string& word : words) values.emplace_back(word, word);
  return choice(std::move(name), std::move(values), std::move(help), target);
}

Parser& Parser::flag(std::string name, std::string help, bool* target, char letter) {
  return add(
      {std::move(name), "", std::move(help), letter,
       [target](const std::string& what, const std::string& text) { assign(what, text, target); }});
}

Parser& Parser::group(std::string heading) {
  return add({"", "", std::move(heading), 0, {}, true});
}

Parser& Parser::common(const std::vector<std::string>& names) {
  common_ = names;
  return *this;
}

void Parser::add_former_names() {
  const size_t n = options_.size();
  for (size_t i = 0; i < n; ++i)
    for (std::string& name : former_options(command_, options_[i].name)) {
      Option former{std::move(name), options_[i].metavar, "", 0, {}};
      former.now = options_[i].name;
      options_.push_back(std::move(former));
    }
}

Parser& Parser::config(ConfigReader reader, std::vector<std::string> others) {
  config_reader_ = std::move(reader);
  config_others_ = std::move(others);
  group("Configuration:");
  option("config", "FILE", "YAML file of option names and values", &config_path_, 'c');
  return *this;
}

Parser::Option& Parser::find(const std::string& source, const std::string& name) {
  std::vector<std::string> known;
  for (Option& option : options_) {
    if (option.is_heading || is_config(option)) continue;
    if (option.name == name) return option;
    if (option.now.empty()) known.push_back(option.name);
  }
  throw UsageError(source, ": unknown key '", name, "'", nearest_name_hint(name, known));
}

Parser::Source Parser::source(const std::string& option) const {
  const auto found = std::ranges::find(options_, option, &Option::name);
  return found == options_.end() ? Source::kDefault : found->source;
}

void Parser::warn_once(const std::string& former, const std::string& now) {
  if (warned_.insert(former).second) warn_deprecated(former, now);
}

void Parser::apply(Option& option, Source source, const std::string& what, std::string text) {
  // "--dtype" on the command line, "REVISIT_DTYPE" in the environment, "dtype" in a config file.
  const auto spelled = [&](const std::string& name) {
    return source == Source::kCommandLine   ? "--" + name
           : source == Source::kEnvironment ? environment_name(name)
                                            : name;
  };
  if (!option.now.empty()) {
    warn_once(what, spelled(option.now));
    return apply(find(what, option.now), source, what, std::move(text));
  }
  if (const std::string now = current_value(option.name, text); now != text) {
    warn_once(what + " " + text, spelled(option.name) + " " + now);
    text = now;
  }
  if (option.clear && option.source != source) option.clear();
  option.source = source;
  option.apply(what, text);
}

void Parser::apply_environment() {
  for (Option& option : options_) {
    if (option.is_heading || is_config(option)) continue;
    const std::string name = environment_name(option.name);
    if (name == "REVISIT_MODELS") continue;
    if (!option.now.empty() && std::getenv(environment_name(option.now).c_str())) continue;
    if (const char* value = std::getenv(name.c_str()))
      apply(option, Source::kEnvironment, name, value);
  }
}

void Parser::apply_positionals(const std::vector<std::string>& arguments) {
  size_t next = 0;
  for (const Positional& positional : positionals_) {
    if (next == arguments.size() && positional.required)
      throw UsageError("missing argument ", positional.name, " (usage: ", command_, " ", usage_,
                       "; see ", command_, " --help)");
    while (next < arguments.size()) {
      positional.apply(positional.name, arguments[next++]);
      if (!positional.repeated) break;
    }
  }
  if (next < arguments.size())
    throw UsageError("unexpected argument '", arguments[next], "' (usage: ", command_, " ", usage_,
                     ")");
}

CommandLine Parser::describe() const {
  const auto values = [](const std::string& name, bool is_path,
                         const std::vector<std::string>& suggested) {
    Values named = values_named(name, is_path);
    named.words.insert(named.words.begin(), suggested.begin(), suggested.end());
    return named;
  };
  CommandLine line;
  line.command = command_;
  for (const Option& option : options_) {
    if (option.is_heading || !option.now.empty()) continue;
    std::optional<Values> value;
    if (!option.metavar.empty()) value = values(option.metavar, option.is_path, option.suggested);
    line.options.push_back({option.name, option.letter, value});
  }
  line.options.push_back({"help", 0, {}});
  line.options.push_back({"usage", 0, {}});
  for (const Positional& positional : positionals_)
    line.arguments.push_back(
        {values(positional.name, positional.is_path, positional.suggested), positional.repeated});
  return line;
}

void Parser::print_help(bool all) const {
  ::setenv("ARGP_HELP_FMT", "no-dup-args-note", 0);
  const std::string usage = "[OPTION...] " + usage_;
  const argp text{nullptr, nullptr, usage.c_str(), summary_.c_str(), nullptr, nullptr, nullptr};
  std::string name = command_;
  argp_help(&text, stdout, ARGP_HELP_SHORT_USAGE | ARGP_HELP_PRE_DOC, name.data());
  if (!examples_.empty()) std::fputs(("\nExamples:\n" + examples_).c_str(), stdout);
  std::fputs("\nOptions:\n", stdout);
  std::vector<argp_option> table;
  int group = 1;
  size_t listed = 0;
  if (all || common_.empty()) {
    for (const Option& option : options_) {
      if (option.is_heading)
        table.push_back({nullptr, 0, nullptr, 0, option.help.c_str(), ++group});
      else if (option.now.empty())
        table.push_back(argp_option_of(option, key_of(option, table.size()), group));
      listed += option.is_heading || !option.now.empty() ? 0 : 1;
    }
  } else {
    for (const std::string& common : common_) {
      const auto found = std::ranges::find(options_, common, &Option::name);
      if (found == options_.end()) throw std::logic_error(command_ + ": no option " + common);
      // argp sorts the options of a group by name.
      table.push_back(argp_option_of(*found, key_of(*found, table.size()), ++group));
      ++listed;
    }
  }
  const size_t options = static_cast<size_t>(std::ranges::count_if(
      options_, [](const Option& o) { return !o.is_heading && o.now.empty(); }));
  table.push_back({"help", kHelpKey, nullptr, 0, "this list", -1});
  table.push_back({"usage", kUsageKey, nullptr, 0, "all options in short", -1});
  table.push_back({});
  const argp list{table.data(), nullptr, nullptr, nullptr, nullptr, nullptr, nullptr};
  argp_help(&list, stdout, ARGP_HELP_LONG, name.data());
  if (listed < options)
    std::fputs(str("\n'", command_, " --help=all' lists all ", options, " options.\n").c_str(),
               stdout);
}

void Parser::parse(std::vector<std::string> arguments) {
  if (asks_for_description(arguments)) throw Described{describe()};
  add_former_names();
  std::vector<argp_option> table;
  for (size_t i = 0; i < options_.size(); ++i)
    if (!options_[i].is_heading)
      table.push_back(argp_option_of(options_[i], key_of(options_[i], i), 1));
  table.push_back({"help", kHelpKey, "all", OPTION_ARG_OPTIONAL, "", -1});
  table.push_back({"usage", kUsageKey, nullptr, 0, "", -1});
  table.push_back({});

  const argp parser{table.data(), collect, usage_.c_str(), summary_.c_str(),
                    nullptr,      nullptr, nullptr};
  std::vector<char*> argv{command_.data()};
  for (std::string& argument : arguments) argv.push_back(argument.data());
  argv.push_back(nullptr);

  argp_err_exit_status = 2;
  Collected collected{{}, {}, &options_, [this](bool all) { print_help(all); }};
  argp_parse(&parser, static_cast<int>(argv.size() - 1), argv.data(), ARGP_NO_HELP, nullptr,
             &collected);

  for (const auto& [option, text] : collected.options) {
    if (!is_config(*option)) continue;
    if (config_path_)
      throw UsageError("--config: expected at most one, found ", config_path_->string(), " and ",
                       text);
    option->apply("--" + option->name, text);
  }
  if (config_path_)
    for (const auto& [name, value] : config_reader_(*config_path_)) {
      if (std::ranges::count(options_, name, &Option::name) == 0 &&
          std::ranges::count(config_others_, current_option("revisit eval", name)))
        continue;
      apply(find(config_path_->string(), name), Source::kConfigFile,
            config_path_->string() + ": " + name, value);
    }
  apply_environment();
  for (const auto& [option, text] : collected.options)
    if (!is_config(*option)) apply(*option, Source::kCommandLine, "--" + option->name, text);
  apply_positionals(collected.positionals);
}

}  // namespace revisit::cli
