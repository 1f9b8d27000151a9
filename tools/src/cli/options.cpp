#include "options.h"

#include <CLI/CLI.hpp>
#include <algorithm>
#include <array>
#include <charconv>
#include <cmath>
#include <cstdlib>
#include <limits>
#include <span>
#include <sstream>

namespace revisit::cli {
namespace {

namespace fs = std::filesystem;

std::string environment_name(const std::string& option) {
  std::string name = "REVISIT_" + option;
  std::ranges::transform(name, name.begin(), [](unsigned char c) {
    return c == '-' ? '_' : static_cast<char>(std::toupper(c));
  });
  return name;
}

bool is_word(const std::string& text) {
  const auto of_words = [](unsigned char c) {
    return (c >= 'a' && c <= 'z') || (c >= '0' && c <= '9') || c == '-' || c == '_' || c == '.';
  };
  return std::ranges::all_of(text, of_words) &&
         std::ranges::any_of(text, [](unsigned char c) { return std::isalnum(c); });
}

std::vector<std::string> split(const std::string& text, char separator) {
  std::vector<std::string> parts;
  std::istringstream in(text);
  for (std::string part; std::getline(in, part, separator);) parts.push_back(part);
  return parts;
}

/// An existing path, perhaps behind "KEY=", wherever a later command runs.
std::string placed(const std::string& given) {
  const size_t path = given.find('=') + 1;
  for (const size_t begin : {size_t{0}, path})
    if (std::error_code none; fs::exists(given.substr(begin), none))
      return given.substr(0, begin) + fs::absolute(given.substr(begin)).string();
  return given;
}

constexpr const char* kConfig = "config";

}  // namespace

std::vector<std::string> comma_separated(const std::string& list) {
  return split(list, ',');
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

bool Row::belongs_to(const std::string& feature) const {
  const std::vector<std::string> names = split(features, ' ');
  return names.empty() || std::ranges::count(names, feature) > 0;
}

std::vector<std::string> Row::possible_words() const {
  std::vector<std::string> possible = words;
  for (const std::string& word : split(is_argument ? name : metavar, '|'))
    if (is_word(word) && std::ranges::count(possible, word) == 0) possible.push_back(word);
  return possible;
}

Paths Row::possible_paths() const {
  Paths paths = is_path ? Paths::kFiles : Paths::kNone;
  for (std::string word : split(is_argument ? name : metavar, '|')) {
    word.resize(std::min(word.find('['), word.size()));  // DIR[,DIR]
    if (word == "DIR") paths = Paths::kFolders;
    if (word == "FILE") paths = Paths::kFiles;
  }
  return paths;
}

Options& Options::add(Row row) {
  row.is_setting = settings_ && !row.is_argument;
  rows_.push_back(std::move(row));
  return *this;
}

size_t Options::index_of_word(const std::string& what, const std::string& text,
                              const std::vector<std::string>& words) {
  const auto found = std::ranges::find(words, text);
  if (found != words.end()) return static_cast<size_t>(found - words.begin());
  const std::span<const std::string> but_last(words.data(), words.size() - 1);
  throw UsageError(what, ": expected ", joined(but_last, ", "), " or ", words.back(), ", found '",
                   text, "'", nearest_name_hint(text, words));
}

Options& Options::choice(std::string name, const std::vector<std::string>& words, std::string help,
                         std::string* target) {
  std::vector<std::pair<std::string, std::string>> values;
  for (const std::string& word : words) values.emplace_back(word, word);
  return choice(std::move(name), std::move(values), std::move(help), target);
}

Options& Options::option(std::string name, std::string help, const std::vector<std::string>& keys,
                         std::map<std::string, double>* target) {
  Row row{std::move(name), "KEY=N[,...]", std::move(help), group_};
  for (const std::string& key : keys) row.words.push_back(key + "=");
  row.set = [target, keys](const std::string& what, const std::string& text) {
    for (const std::string& part : comma_separated(text)) {
      const size_t equals = part.find('=');
      if (equals == std::string::npos)
        throw UsageError(what, ": expected KEY=N[,...], found '", text, "'");
      const std::string& key = keys[index_of_word(what, part.substr(0, equals), keys)];
      (*target)[key] = parse_value<double>(what + " " + key, part.substr(equals + 1));
    }
  };
  row.text = [target] {
    return joined(*target, ",",
                  [](const auto& one) { return one.first + "=" + exact(one.second); });
  };
  return add(std::move(row));
}

Options& Options::flag(std::string name, std::string help, bool* target, char letter) {
  return option(std::move(name), "", std::move(help), target, letter);
}

Options& Options::format(const std::vector<std::string>& words, std::string* target) {
  return choice("format", words, "format of the output (default " + words.front() + ")", target);
}

Options& Options::group(std::string heading, bool settings) {
  group_ = std::move(heading);
  settings_ = settings;
  return *this;
}

Options& Options::needs(std::string option) {
  rows_.back().needed.push_back(std::move(option));
  return *this;
}

Options& Options::checked(std::function<void(const std::string& what, double value)> check) {
  auto& set = rows_.back().set;
  set = [set, check = std::move(check)](const std::string& what, const std::string& text) {
    set(what, text);
    check(what, parse_value<double>(what, text));
  };
  return *this;
}

Options& Options::at_least(double least) {
  return checked([least](const std::string& what, double value) {
    if (!(value >= least))
      throw UsageError(what, ": expected at least ", exact(least), ", found ", exact(value));
  });
}

Options& Options::between(double least, double most) {
  return checked([least, most](const std::string& what, double value) {
    if (!(value >= least && value <= most))
      throw UsageError(what, ": expected ", exact(least), " to ", exact(most), ", found ",
                       exact(value));
  });
}

Options& Options::positive() {
  return checked([](const std::string& what, double value) {
    if (!(value > 0)) throw UsageError(what, ": expected a positive number, found ", exact(value));
  });
}

Options& Options::check(std::function<void()> check) {
  checks_.push_back(std::move(check));
  return *this;
}

Options& Options::config(ConfigReader reader) {
  config_reader_ = std::move(reader);
  group("Configuration:", false);
  return option(kConfig, "FILE", "YAML file of option names and values", &config_files_, 'c');
}

const Row& Options::row(const std::string& name) const {
  const auto found = std::ranges::find(rows_, name, &Row::name);
  if (found == rows_.end()) throw std::logic_error(command_ + " has no option " + name);
  return *found;
}

std::vector<std::pair<std::string, std::string>> Options::settings() const {
  std::vector<std::pair<std::string, std::string>> settings;
  for (const Row& row : rows_) {
    if (!row.is_setting) continue;
    std::string text = row.text();
    if (row.possible_paths() != Paths::kNone && std::ranges::count(row.possible_words(), text) == 0)
      text = joined(comma_separated(text), ",", placed);
    settings.emplace_back(row.name, text);
  }
  return settings;
}

Row& Options::find(const std::string& source, const std::string& name) {
  std::vector<std::string> known;
  for (Row& row : rows_) {
    if (row.is_argument || row.name == kConfig) continue;
    if (row.name == name) return row;
    known.push_back(row.name);
  }
  throw UsageError(source, ": unknown key '", name, "'", nearest_name_hint(name, known));
}

void Options::set(Row& row, Source source, const std::string& what, const std::string& text) {
  if (row.clear && row.source != source) row.clear();
  row.source = source;
  if (!row.print_list || text != "list") row.set(what, text);
}

void Options::read_config_file() {
  if (config_files_.size() > 1)
    throw UsageError("--config: expected at most one, found ", joined(config_files_, " and "));
  for (const fs::path& file : config_files_)
    for (const auto& [name, value] : config_reader_(file))
      set(find(file.string(), name), Source::kConfigFile, file.string() + ": " + name, value);
}

void Options::read_environment() {
  for (Row& row : rows_) {
    if (row.is_argument || row.name == kConfig) continue;
    const std::string name = environment_name(row.name);
    if (name == "REVISIT_MODELS") continue;
    if (const char* value = std::getenv(name.c_str())) set(row, Source::kEnvironment, name, value);
  }
}

void Options::set_arguments(const Arguments& words) {
  size_t next = 0;
  for (Row& row : rows_) {
    if (!row.is_argument) continue;
    if (next == words.size() && row.is_required)
      throw UsageError("missing argument ", row.name, "; see ", command_, " --help");
    while (next < words.size()) {
      set(row, Source::kCommandLine, row.name, words[next++]);
      if (!row.is_repeatable()) break;
    }
  }
  if (next < words.size())
    throw UsageError("unexpected argument '", words[next], "'; see ", command_, " --help");
}

/// The words that are neither options nor their values.
Arguments arguments_among(const std::vector<std::string>& words, const std::vector<Row>& rows,
                          const std::string& command) {
  Arguments arguments;
  bool only_arguments = false;
  for (const std::string& word : words) {
    if (!only_arguments && word == "--") {
      only_arguments = true;
    } else if (!only_arguments && word.size() > 1 && word[0] == '-') {
      std::vector<std::string> known{"--help"};
      for (const Row& row : rows)
        if (!row.is_argument) known.push_back(row.spelled());
      throw UsageError("unrecognized option '", word, "'",
                       nearest_name_hint(word.substr(0, word.find('=')), known), "; see ", command,
                       " --help");
    } else {
      arguments.push_back(word);
    }
  }
  return arguments;
}

Options::Parsed Options::parse(const Arguments& arguments) {
  arguments_ = arguments;
  CLI::App app;
  app.set_help_flag();
  app.allow_extras();
  std::string help;
  app.add_flag("-h,--help", help);
  std::vector<std::vector<std::string>> values(rows_.size());  // by row
  for (size_t i = 0; i < rows_.size(); ++i) {
    if (rows_[i].is_argument) continue;
    const std::string letter = rows_[i].letter ? str('-', rows_[i].letter, ',') : "";
    CLI::Option* const option =
        rows_[i].is_flag() ? app.add_flag(letter + rows_[i].spelled())->disable_flag_override()
                           : app.add_option(letter + rows_[i].spelled(), values[i])->expected(1);
    option->allow_extra_args(false)->multi_option_policy(CLI::MultiOptionPolicy::TakeAll);
    if (!rows_[i].is_flag()) option->type_name(rows_[i].metavar);
  }
  try {
    app.parse(std::vector<std::string>(arguments.rbegin(), arguments.rend()));
  } catch (const CLI::ParseError& error) {
    throw UsageError(error.what(), "; see ", command_, " --help");
  }
  const auto words = arguments_among(app.remaining(), rows_, command_);
  if (help == "all") return Parsed::kHelpAll;
  if (!help.empty() && help != "true")
    throw UsageError("--help: expected no value or 'all', found '", help, "'");
  if (!help.empty()) return Parsed::kHelp;
  for (size_t i = 0; i < rows_.size(); ++i) {
    if (rows_[i].is_argument) continue;
    if (rows_[i].is_flag() && app.count(rows_[i].spelled()) > 0) values[i] = {""};
    if (rows_[i].name == kConfig)
      for (const std::string& value : values[i]) rows_[i].set("--config", value);
  }
  read_config_file();
  read_environment();
  for (size_t i = 0; i < rows_.size(); ++i)
    for (const std::string& value : values[i])
      if (rows_[i].name != kConfig) set(rows_[i], Source::kCommandLine, rows_[i].spelled(), value);
  for (size_t i = 0; i < rows_.size(); ++i)
    if (rows_[i].print_list && !values[i].empty() && values[i].back() == "list") {
      rows_[i].print_list();
      return Parsed::kList;
    }
  set_arguments(words);
  check_rows();
  for (const auto& check : checks_) check();
  return Parsed::kRun;
}

/// An output would overwrite an input or another output.
void Options::check_output(const Row& output) const {
  std::error_code error;
  const std::filesystem::path file = weakly_canonical(std::filesystem::path(output.text()), error);
  for (const Row& other : rows_)
    if (&other != &output && (other.is_path || other.metavar == "FILE") && !file.empty() &&
        other.text() != "-" && std::filesystem::weakly_canonical(other.text(), error) == file)
      throw UsageError(output.spelled(), ": ", file.string(), " is the file of ", other.spelled(),
                       ", too, and would be overwritten; give another file");
}

void Options::check_rows() const {
  constexpr std::array kOutputs = {"cloud", "g2o", "graph", "output", "tum"};
  for (const Row& row : rows_) {
    if (std::ranges::find(kOutputs, row.name) != kOutputs.end()) check_output(row);
    if (row.is_required && !row.is_argument && row.source == Source::kDefault)
      throw UsageError("missing required option ", row.spelled(), " ", row.metavar);
    if (row.source != Source::kCommandLine) continue;
    for (const std::string& name : row.needed)
      if (this->row(name).source == Source::kDefault)
        throw UsageError(row.spelled(), ": needs --", name);
    for (const std::string& name : row.excluded)
      if (given(name))
        throw UsageError(row.spelled(), ": not with --", name, "; give one of the two");
  }
}

}  // namespace revisit::cli
