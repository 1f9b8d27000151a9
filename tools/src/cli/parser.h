#pragma once

#include <filesystem>
#include <functional>
#include <optional>
#include <set>
#include <string>
#include <type_traits>
#include <vector>

#include "cli/command_line.h"
#include "revisit/base/error.h"
#include "revisit/base/text.h"

namespace revisit::cli {

/// Converts the text of `what`, e.g. "--threads"; throws UsageError if it does not fit T.
template <class T>
T parse_value(const std::string& what, const std::string& text);

/// Splits at commas; "" and the end of "a," yield no part.
std::vector<std::string> comma_separated(const std::string& list);

/// Command line of one subcommand: a typed front of glibc's argp.
///
/// Order of precedence: default < config file < environment < command line. Config files use long
/// names, the environment uses `REVISIT_<LONG_NAME>`. $REVISIT_MODELS is not an option: it is the
/// folder of fetched models (models/cache.h). A repeatable option takes the values of the last
/// source that has any. Former names (cli/renamed.h) work, with one warning each.
class Parser {
 public:
  /// `usage`: argument synopsis ("PROTOTXT [WEIGHTS]").
  Parser(std::string command, std::string usage, std::string summary, std::string examples);

  /// `target` keeps its initial value as the default. T: std::string, int, int64_t, double,
  /// std::filesystem::path, std::optional of these, or std::vector of these (repeatable option).
  template <class T>
  Parser& option(std::string name, std::string metavar, std::string help, T* target,
                 char letter = 0) {
    add({std::move(name), std::move(metavar), std::move(help), letter,
         [target](const std::string& what, const std::string& text) {
           assign(what, text, target);
         }});
    options_.back().is_path = kIsPath<T>;
    if constexpr (IsVector<T>::value) options_.back().clear = [target] { target->clear(); };
    return *this;
  }

  /// Target: T or std::optional<T>.
  template <class T, class Target>
  Parser& choice(std::string name, std::vector<std::pair<std::string, T>> values, std::string help,
                 Target* target) {
    std::vector<std::string> words;
    for (const auto& [word, value] : values) words.push_back(word);
    constexpr size_t kLongest = 34;  // argp breaks a help badly after a longer list
    const std::string list = joined(words, "|");
    add({std::move(name), list.size() > kLongest ? "NAME" : list, std::move(help), 0,
         [target, words, values](const std::string& what, const std::string& text) {
           *target = values[index_of_word(what, text, words)].second;
         }});
    return list.size() > kLongest ? suggest(words) : *this;
  }
  Parser& choice(std::string name, const std::vector<std::string>& words, std::string help,
                 std::string* target);

  Parser& flag(std::string name, std::string help, bool* target, char letter = 0);

  template <class T>
  Parser& positional(std::string name, T* target) {
    return add_positional(std::move(name), true, target);
  }
  /// Takes all remaining arguments if the target is a vector.
  template <class T>
  Parser& optional_positional(std::string name, T* target) {
    return add_positional(std::move(name), false, target);
  }

  /// Adds words for shell completion of the last declared option or argument, without a check.
  Parser& suggest(const std::vector<std::string>& words);

  Parser& group(std::string heading);

  /// Sets the options that --help lists, in this order (default: all). --help=all lists all.
  Parser& common(const std::vector<std::string>& names);

  /// Values by long option name. Called with the path of `--config`, before the command line.
  using ConfigReader =
      std::function<std::vector<std::pair<std::string, std::string>>(const std::filesystem::path&)>;
  /// Adds `-c/--config FILE`. Keys in `others`, options of another command, are ignored.
  Parser& config(ConfigReader reader, std::vector<std::string> others = {});

  /// `arguments` exclude the program and the subcommand. Exits after --help and --usage, and with
  /// 2 for a misused command line. Throws UsageError for a value that does not fit, and Described
  /// for a description.
  void parse(std::vector<std::string> arguments);

  /// Ascending precedence.
  enum class Source { kDefault, kConfigFile, kEnvironment, kCommandLine };

  /// kDefault before parse() and for an undeclared option.
  Source source(const std::string& option) const;
  bool given(const std::string& option, Source least = Source::kCommandLine) const {
    return source(option) >= least;
  }

  struct Option {
    std::string name, metavar, help;
    char letter = 0;
    std::function<void(const std::string& what, const std::string& text)> apply;
    bool is_heading = false;
    std::function<void()> clear = {};  // for a repeatable option
    Source source = Source::kDefault;
    bool is_path = false;
    std::vector<std::string> suggested = {};
    std::string now = {};  // current name of a former name
  };

 private:
  struct Positional {
    std::string name;
    bool required = false, repeated = false, is_path = false;
    std::function<void(const std::string& what, const std::string& text)> apply;
    std::vector<std::string> suggested = {};
  };

  template <class T>
  static void assign(const std::string& what, const std::string& text, T* target) {
    *target = parse_value<T>(what, text);
  }
  template <class T>
  static void assign(const std::string& what, const std::string& text, std::optional<T>* target) {
    *target = parse_value<T>(what, text);
  }
  template <class T>
  static void assign(const std::string& what, const std::string& text, std::vector<T>* target) {
    target->push_back(parse_value<T>(what, text));
  }

  template <class T>
  struct IsVector : std::false_type {};
  template <class T>
  struct IsVector<std::vector<T>> : std::true_type {};

  template <class T>
  static constexpr bool kIsPath = std::is_same_v<T, std::filesystem::path> ||
                                  std::is_same_v<T, std::optional<std::filesystem::path>> ||
                                  std::is_same_v<T, std::vector<std::filesystem::path>>;

  template <class T>
  Parser& add_positional(std::string name, bool required, T* target) {
    last_is_positional_ = true;
    positionals_.push_back({std::move(name), required, IsVector<T>::value, kIsPath<T>,
                            [target](const std::string& what, const std::string& text) {
                              assign(what, text, target);
                            }});
    return *this;
  }
  Parser& add(Option option);
  void add_former_names();
  static size_t index_of_word(const std::string& what, const std::string& text,
                              const std::vector<std::string>& words);
  void apply(Option& option, Source source, const std::string& what, std::string text);
  void warn_once(const std::string& former, const std::string& now);
  Option& find(const std::string& source, const std::string& name);
  void apply_environment();
  void apply_positionals(const std::vector<std::string>& arguments);
  CommandLine describe() const;
  void print_help(bool all) const;

  std::string command_, usage_, summary_, examples_;
  std::vector<Option> options_;
  std::vector<Positional> positionals_;
  std::vector<std::string> common_;
  std::set<std::string> warned_;
  bool last_is_positional_ = false;
  ConfigReader config_reader_;
  std::vector<std::string> config_others_;
  std::optional<std::filesystem::path> config_path_;
};

}  // namespace revisit::cli
