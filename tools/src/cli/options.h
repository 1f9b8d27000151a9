#pragma once

#include <filesystem>
#include <functional>
#include <map>
#include <optional>
#include <string>
#include <type_traits>
#include <utility>
#include <vector>

#include "revisit/base/error.h"
#include "revisit/base/text.h"

namespace revisit::cli {

using Arguments = std::vector<std::string>;

/// Converts the text of `what`, e.g. "--threads"; throws UsageError if it does not fit T.
template <class T>
T parse_value(const std::string& what, const std::string& text);

/// Text that parse_value() reads back.
template <class T>
std::string text_of_value(const T& value) {
  if constexpr (std::is_same_v<T, double>)
    return exact(value);
  else if constexpr (std::is_same_v<T, std::filesystem::path>)
    return value.string();
  else if constexpr (std::is_same_v<T, bool>)
    return value ? "true" : "";
  else
    return str(value);
}

/// Splits at commas; "" and the end of "a," yield no part.
std::vector<std::string> comma_separated(const std::string& list);

/// Where a value comes from. Ascending precedence.
enum class Source { kDefault, kConfigFile, kEnvironment, kCommandLine };

/// Paths that are possible values; kFiles includes the folders on the way.
enum class Paths { kNone, kFolders, kFiles };

/// All that parsing, help, completion, config files, the environment and checks know of an option,
/// or of an argument of a command.
struct Row {
  std::string name;     // without dashes; of an argument, e.g. "DATA"
  std::string metavar;  // "": a flag
  std::string help, group;
  char letter = 0;            // 0: none
  std::string features = {};  // that use it, e.g. "cnn ring"; "": all
  bool is_argument = false, is_required = false, is_path = false, is_common = false;
  bool is_setting = false;  // it changes results
  std::vector<std::string> words = {}, needed = {}, excluded = {};
  std::function<void()> print_list = {};  // for the value `list`
  std::function<void(const std::string& what, const std::string& text)> set = {};
  std::function<void()> clear = {};        // of a repeatable option
  std::function<std::string()> text = {};  // of the present value; "": none
  Source source = Source::kDefault;

  bool is_flag() const { return metavar.empty() && !is_argument; }
  bool is_repeatable() const { return clear != nullptr; }
  bool belongs_to(const std::string& feature) const;
  /// "--name", or the name of an argument.
  std::string spelled() const { return is_argument ? name : "--" + name; }
  /// Possible values for completion: words of the metavar "K|all|none" in lower case and suggested
  /// words; folders for DIR; files for FILE or a path.
  std::vector<std::string> possible_words() const;
  Paths possible_paths() const;
};

/// The options of a command: a table of rows that exists before anything runs.
///
/// Order of precedence: default < config file < environment < command line. Config files use long
/// names, the environment uses `REVISIT_<LONG_NAME>`. $REVISIT_MODELS is not an option: it is the
/// folder of fetched models (models/models.h). A repeatable option takes the values of the last
/// source that has any.
class Options {
 public:
  /// `command`: e.g. "revisit loops".
  explicit Options(std::string command) : command_(std::move(command)) {}
  Options(const Options&) = delete;
  Options& operator=(const Options&) = delete;

  /// Rows hold `target`, which keeps its initial value as the default. T: std::string, int,
  /// int64_t, double, std::filesystem::path, std::optional of these, or std::vector of these
  /// (repeatable option).
  template <class T>
  Options& option(std::string name, std::string metavar, std::string help, T* target,
                  char letter = 0) {
    Row row{std::move(name), std::move(metavar), std::move(help), group_, letter};
    bind(row, target);
    return add(std::move(row));
  }

  /// Numbers by key, "KEY=NUMBER,KEY=NUMBER".
  Options& option(std::string name, std::string help, const std::vector<std::string>& keys,
                  std::map<std::string, double>* target);

  /// Target: T or std::optional<T>.
  template <class T, class Target>
  Options& choice(std::string name, std::vector<std::pair<std::string, T>> values, std::string help,
                  Target* target) {
    Row row{std::move(name), "", std::move(help), group_};
    for (const auto& [word, value] : values) row.words.push_back(word);
    constexpr size_t kLongest = 34;
    const std::string list = joined(row.words, "|");
    row.metavar = list.size() > kLongest ? "NAME" : list;
    row.set = [target, words = row.words, values](const std::string& what,
                                                  const std::string& text) {
      *target = values[index_of_word(what, text, words)].second;
    };
    row.text = [target, values]() -> std::string {
      for (const auto& [word, value] : values)
        if (*target == value) return word;
      return "";
    };
    return add(std::move(row));
  }
  Options& choice(std::string name, const std::vector<std::string>& words, std::string help,
                  std::string* target);

  Options& flag(std::string name, std::string help, bool* target, char letter = 0);

  /// --format, `words[0]` by default.
  Options& format(const std::vector<std::string>& words, std::string* target);

  /// Required unless optional() follows. Takes all remaining arguments if the target is a vector.
  template <class T>
  Options& argument(std::string name, T* target) {
    Row row{std::move(name), "", "", ""};
    row.is_argument = row.is_required = true;
    bind(row, target);
    return add(std::move(row));
  }

  /// Heading of the next options. `settings`: they change results.
  Options& group(std::string heading, bool settings = true);

  // Of the last row:
  Options& required(bool is_required = true) { return last(&Row::is_required, is_required); }
  Options& optional() { return required(false); }
  /// Listed by --help, which else lists all options if none is common. --help=all lists all.
  Options& common(bool is_common = true) { return last(&Row::is_common, is_common); }
  /// Words for completion, without a check.
  Options& suggest(std::vector<std::string> words) { return last(&Row::words, std::move(words)); }
  /// Features that use it, e.g. "cnn ring".
  Options& of_features(std::string names) { return last(&Row::features, std::move(names)); }
  Options& needs(std::string option);
  Options& excludes(std::vector<std::string> options) {
    return last(&Row::excluded, std::move(options));
  }
  /// The value `list` calls `print` instead of running the command.
  Options& listed_by(std::function<void()> print) {
    return last(&Row::print_list, std::move(print));
  }
  Options& at_least(double least);
  Options& between(double least, double most);
  Options& positive();

  /// `check` runs after parsing, in the order of declaration. It may throw UsageError.
  Options& check(std::function<void()> check);

  /// Values by long option name. Called with the path of `--config`, before the command line.
  using ConfigReader =
      std::function<std::vector<std::pair<std::string, std::string>>(const std::filesystem::path&)>;
  /// Adds `-c/--config FILE`.
  Options& config(ConfigReader reader);

  /// kRun: the command runs. kList: a list was printed instead.
  enum class Parsed { kRun, kList, kHelp, kHelpAll };

  /// `arguments` exclude the program and the subcommand. Throws UsageError.
  Parsed parse(const Arguments& arguments);

  const std::string& command() const { return command_; }
  const std::vector<Row>& rows() const { return rows_; }
  /// Arguments of parse().
  const Arguments& arguments() const { return arguments_; }
  /// Throws std::logic_error for an undeclared option.
  const Row& row(const std::string& name) const;
  /// Only on the command line, unless `least` says otherwise. Files and the environment may hold
  /// options of other commands.
  bool given(const std::string& name, Source least = Source::kCommandLine) const {
    return row(name).source >= least;
  }
  /// Names and values ("": none) of the options that change results.
  std::vector<std::pair<std::string, std::string>> settings() const;

 private:
  template <class T>
  struct Element {
    using Type = T;
    static constexpr bool kIsList = false;
  };
  template <class T>
  struct Element<std::optional<T>> : Element<T> {};
  template <class T>
  struct Element<std::vector<T>> {
    using Type = T;
    static constexpr bool kIsList = true;
  };

  template <class T>
  static void bind(Row& row, T* target) {
    using One = typename Element<T>::Type;
    row.is_path = std::is_same_v<One, std::filesystem::path>;
    if constexpr (Element<T>::kIsList) {
      row.set = [target](const std::string& what, const std::string& text) {
        target->push_back(parse_value<One>(what, text));
      };
      row.clear = [target] { target->clear(); };
      row.text = [target] { return joined(*target, ",", text_of_value<One>); };
    } else {
      row.set = [target](const std::string& what, const std::string& text) {
        *target = parse_value<One>(what, text);
      };
      row.text = [target]() -> std::string {
        if constexpr (std::is_same_v<T, One>)
          return text_of_value(*target);
        else
          return *target ? text_of_value(**target) : "";
      };
    }
  }

  Options& add(Row row);
  /// Sets a member of the last row.
  template <class Value>
  Options& last(Value Row::*member, Value value) {
    rows_.back().*member = std::move(value);
    return *this;
  }
  static size_t index_of_word(const std::string& what, const std::string& text,
                              const std::vector<std::string>& words);
  /// Calls `check` with the number of the last row when it is set.
  Options& checked(std::function<void(const std::string& what, double value)> check);
  Row& find(const std::string& source, const std::string& name);
  void set(Row& row, Source source, const std::string& what, const std::string& text);
  void read_config_file();
  void read_environment();
  void set_arguments(const Arguments& words);
  void check_rows() const;
  void check_output(const Row& output) const;

  std::string command_, group_;
  bool settings_ = true;
  std::vector<Row> rows_;
  std::vector<std::function<void()>> checks_;
  ConfigReader config_reader_;
  std::vector<std::filesystem::path> config_files_;
  Arguments arguments_;
};

}  // namespace revisit::cli
