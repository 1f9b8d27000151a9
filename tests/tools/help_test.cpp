#include <fcntl.h>
#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

#include <iostream>
#include <regex>

#include "cli/command.h"
#include "cli/terminal.h"
#include "testing.h"

namespace revisit {
namespace {

TEST(Help, ListsNothingHidden) {
  const std::string help = run_revisit("--help").out;
  EXPECT_EQ(help.find("completion"), std::string::npos) << help;
  EXPECT_HAS(help, "Exit codes: 0 ok; 1 failed;");
}

std::string help_of(const std::string& command, const std::string& how) {
  const auto help = run_ok(command.substr(sizeof "revisit") + " " + how);
  EXPECT_EQ(help.err, "") << command;
  return help.out;
}

void for_each_command(const std::function<void(const cli::Options&)>& use) {
  cli::for_each_command(cli::revisit_program(), "revisit",
                        [&](const cli::Command& command, const cli::Options& options) {
                          if (command.below.empty() && command.name != "simulate")
                            use(options);  // another program
                        });
}

std::set<std::string> options_in(const std::string& help) {
  const std::regex option(R"(\n +(?:-., )?--([a-z0-9-]+))");
  std::set<std::string> options;
  for (std::sregex_iterator at(help.begin(), help.end(), option), end; at != end; ++at)
    options.insert((*at)[1]);
  return options;
}

TEST(Help, FitsOnTwoScreensAndAllOfItListsEveryOption) {
  static constexpr int kScreens = 96, kColumns = 100, kOfFrequentCommands = 72;
  for_each_command([](const cli::Options& of_command) {
    const std::string& command = of_command.command();
    const std::string help = help_of(command, "--help"), all = help_of(command, "--help=all");
    EXPECT_EQ(help_of(command, "-h"), help);
    int lines = 0;
    std::istringstream in(help);
    for (std::string text; std::getline(in, text); ++lines)
      EXPECT_LE(text.size(), kColumns) << command << ": " << text;
    const bool frequent = command == "revisit loops" || command == "revisit eval";
    EXPECT_LE(lines, frequent ? kOfFrequentCommands : kScreens) << command;
    std::set<std::string> options{"help"};
    for (const cli::Row& row : of_command.rows())
      if (!row.is_argument) options.insert(row.name);
    EXPECT_EQ(options_in(all), options) << command;
    const bool shortened = options_in(help) != options;
    EXPECT_EQ(help.find("--help=all' lists all ") != std::string::npos, shortened) << command;
    EXPECT_EQ(all.find("lists all "), std::string::npos) << command;
  });
  EXPECT_EQ(run_revisit("eval --help=some").exit_code, 2);
}

/// Forks, because starting the program takes too long for hundreds of options; limits the child to
/// one second of processor time.
std::string error_of(const cli::Arguments& arguments, const std::filesystem::path& folder) {
  const std::filesystem::path file = folder / "error";
  const pid_t child = ::fork();
  if (child == 0) {
    constexpr rlimit kSecond{1, 1};
    ::setrlimit(RLIMIT_CPU, &kSecond);
    std::filesystem::current_path(folder);
    ::dup2(::open("/dev/null", O_RDWR | O_CLOEXEC), STDIN_FILENO);
    ::dup2(STDIN_FILENO, STDOUT_FILENO);
    ::dup2(::open(file.c_str(), O_WRONLY | O_CREAT | O_TRUNC | O_CLOEXEC, 0600), STDERR_FILENO);
    try {
      cli::run_revisit(arguments);
    } catch (const Error& error) {
      std::cerr << error.what();
    } catch (const std::exception& error) {
      std::cerr << error.what();
    }
    ::_exit(0);
  }
  EXPECT_EQ(::waitpid(child, nullptr, 0), child);
  return read_file(file);
}

std::string value_of(const cli::Row& row) {
  if (row.is_flag()) return "";
  for (const std::string& word : row.possible_words())
    if (word != "list") return "=" + word;
  return row.possible_paths() == cli::Paths::kNone ? "=1" : "=nowhere";
}

/// The command finds nothing to work on.
cli::Arguments arguments_for(const cli::Options& options) {
  std::istringstream verbs(options.command().substr(sizeof "revisit"));
  cli::Arguments arguments(std::istream_iterator<std::string>(verbs), {});
  for (const cli::Row& row : options.rows())
    if (row.is_argument) arguments.push_back("nowhere");
  return arguments;
}

TEST(Help, ListsNoOptionThatTheCommandRejects) {
  const TempDir dir;  // empty: commands end after parsing
  int options = 0, answered = 0;
  for_each_command([&](const cli::Options& of_command) {
    const cli::Arguments command = arguments_for(of_command);
    for (const cli::Row& row : of_command.rows()) {
      if (row.is_argument) continue;
      cli::Arguments arguments = command;
      arguments.push_back(row.spelled() + value_of(row));
      if (!row.features.empty())
        arguments.push_back("--feature=" + row.features.substr(0, row.features.find(' ')));
      const std::string error = error_of(arguments, dir.path());
      static const std::regex kRejected(
          "unrecognized|belongs to|leave it out|unsupported|not supported|all of them at once");
      EXPECT_FALSE(std::regex_search(error, kRejected))
          << of_command.command() << " " << arguments.back() << ": " << error;
      ++options;
      answered += error.empty() ? 0 : 1;
    }
  });
  EXPECT_GT(options, 100);
  EXPECT_GT(answered, options / 2);  // most commands miss their files
}

}  // namespace
}  // namespace revisit
