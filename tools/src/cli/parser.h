#pragma once

#include <filesystem>
#include <functional>
#include <optional>
#include <string>
#include <type_traits>
#include <vector>

#include "cli/command_line.h"
#include "revisit/base/error.h"
#include "revisit/base/joined.h"

namespace revisit::cli {

/// Converts the text of `what`, e.g. "--threads"; throws UsageError when it does not fit T.
template <class T>
T parse_value(const std::string& what, const std::string& text);

/// What stands between commas; nothing for "" and behind a last comma.
std::vector<std::string> comma_separated(const std::string& list);

/// The command line of one subcommand: a typed front of glibc's argp.
///
/// Values are applied in the order defaults < config file < environment < command line: the
/// configuration sets them by long name, `REVISIT_<LONG_NAME>` does the same from the environment
/// (but for $REVISIT_MODELS, which is the folder of fetched models: models/cache.h). A repeatable
/// option takes the values of the last source that has any.
class Parser {
 public:
  /// `usage` is the argument synopsis ("PROTOTXT [WEIGHTS]"); `examples` is printed under --help.
  Parser(std::string command, std::string usage, std::string summary, std::string examples);

  /// An option that takes a value. `target` keeps its initial value as the default.
  /// T: std::string, int, int64_t, double, std::filesystem::path, std::optional of these, or
  /// std::vector of these (repeatable option).
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

  /// An option whose value is one of some words; `target` is a T or a std::optional<T>.
  template <class T, class Target>
  Parser& choice(std::string name, std::vector<std::pair<std::string, T>> values, std::string help,
                 Target* target) {
    std::vector<std::string> words;
    for (const auto& [word, value] : values) words.push_back(word);
    return add({std::move(name), joined(words, "|"), std::move(help), 0,
                [target, words, values](const std::string& what, const std::string& text) {
                  *target = values[index_of_word(what, text, words)].second;
                }});
  }
  /// The same where the word itself is the value.
  Parser& choice(std::string name, const std::vector<std::string>& words, std::string help,
                 std::string* target);

  Parser& flag(std::string name, std::string help, bool* target, char letter = 0);

  template <class T>
  Parser& positional(std::string name, T* target) {
    return add_positional(std::move(name), true, target);
  }
  /// The next positional argument, optional. A vector target takes all that remain.
  template <class T>
  Parser& optional_positional(std::string name, T* target) {
    return add_positional(std::move(name), false, target);
  }

  /// Words for shell completion of the option or argument declared last; nothing is checked.
  Parser& suggest(const std::vector<std::string>& words);

  /// A former name of the option declared last: accepted with a note, but in no help.
  Parser& formerly(std::string name);

  Parser& group(std::string heading);

  /// Values by long option name. Called with the path of `--config`, before the command line.
  using ConfigReader =
      std::function<std::vector<std::pair<std::string, std::string>>(const std::filesystem::path&)>;
  /// Adds `-c/--config FILE`, which may also hold values of `others`, another command's options.
  Parser& config(ConfigReader reader, std::vector<std::string> others = {});

  /// Parses `arguments` (without the program and subcommand names) and fills the targets.
  /// Prints help and exits for --help/--usage; a misused command line prints a hint and exits 2.
  /// Throws UsageError for values that do not fit, and Described when asked for a description.
  void parse(std::vector<std::string> arguments);

  /// Each overrules those before it.
  enum class Source { kDefault, kConfigFile, kEnvironment, kCommandLine };

  /// Whether the option has a value from `least` or what overrules it; after parse().
  bool given(const std::string& option, Source least = Source::kCommandLine) const;

  struct Option {
    std::string name, metavar, help;
    char letter = 0;
    std::function<void(const std::string& what, const std::string& text)> apply;
    bool is_heading = false;
    std::function<void()> clear = {};  // of a repeatable option
    Source source = Source::kDefault;
    bool is_path = false;
    std::vector<std::string> suggested = {};
    std::string now = {};  // of a former name: the name now
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
  static size_t index_of_word(const std::string& what, const std::string& text,
                              const std::vector<std::string>& words);
  void apply(Option& option, Source source, const std::string& what, const std::string& text);
  Option& find(const std::string& source, const std::string& name);
  void apply_environment();
  void apply_positionals(const std::vector<std::string>& arguments);
  CommandLine describe() const;

  std::string command_, usage_, summary_, examples_;
  std::vector<Option> options_;
  std::vector<Positional> positionals_;
  bool last_is_positional_ = false;
  ConfigReader config_reader_;
  std::vector<std::string> config_others_;
  std::optional<std::filesystem::path> config_path_;
};

}  // namespace revisit::cli
