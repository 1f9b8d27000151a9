#include <fcntl.h>
#include <gtest/gtest.h>
#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <filesystem>
#include <iostream>
#include <iterator>
#include <regex>
#include <set>
#include <sstream>

#include "cli/command.h"
#include "cli/command_line.h"
#include "cli/messages.h"
#include "cli/renamed.h"
#include "test_data.h"

namespace revisit {
namespace {

TEST(Help, ListsNothingHidden) {
  const std::string help = test::run_revisit("--help").out;
  EXPECT_EQ(help.find("completion"), std::string::npos) << help;
  EXPECT_NE(help.find("Exit codes: 0 ok; 1 failed;"), std::string::npos) << help;
}

std::string help_of(const cli::CommandLine& line, const std::string& how) {
  const auto help = test::run_revisit(line.command.substr(sizeof "revisit") + " " + how);
  EXPECT_EQ(help.exit_code, 0) << line.command;
  EXPECT_EQ(help.err, "") << line.command;
  return help.out;
}

std::vector<cli::CommandLine> commands() {
  std::vector<cli::CommandLine> all = cli::all_of(cli::describe(cli::revisit_command));
  std::erase_if(all, [](const cli::CommandLine& line) { return !line.below.empty(); });
  return all;
}

std::set<std::string> options_in(const std::string& help) {
  const std::regex option(R"(\n +(?:-., )?--([a-z0-9-]+))");
  std::set<std::string> options;
  for (std::sregex_iterator at(help.begin(), help.end(), option), end; at != end; ++at)
    options.insert((*at)[1]);
  return options;
}

TEST(Help, FitsOnTwoScreensAndAllOfItListsEveryOption) {
  constexpr int kScreens = 96, kColumns = 100, kOfFrequentCommands = 72;
  for (const cli::CommandLine& line : commands()) {
    const std::string help = help_of(line, "--help"), all = help_of(line, "--help=all");
    int lines = 0;
    std::istringstream in(help);
    for (std::string text; std::getline(in, text); ++lines)
      EXPECT_LE(text.size(), kColumns) << line.command << ": " << text;
    const bool frequent = line.command == "revisit loops" || line.command == "revisit eval";
    EXPECT_LE(lines, frequent ? kOfFrequentCommands : kScreens) << line.command;
    std::set<std::string> options;
    for (const cli::CommandLine::Option& option : line.options) options.insert(option.name);
    EXPECT_EQ(options_in(all), options) << line.command;
    const bool shortened = options_in(help) != options;
    EXPECT_EQ(help.find("--help=all' lists all ") != std::string::npos, shortened) << line.command;
    EXPECT_EQ(all.find("lists all "), std::string::npos) << line.command;
  }
  EXPECT_EQ(test::run_revisit("eval --help=some").exit_code, 2);
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
      cli::revisit_command(arguments);
    } catch (const Error& error) {
      std::cerr << cli::message_of(error);
    } catch (const std::exception& error) {
      std::cerr << error.what();
    }
    ::_exit(0);
  }
  EXPECT_EQ(::waitpid(child, nullptr, 0), child);
  return test::read_file(file);
}

std::string value_of(const cli::Values& values) {
  if (!values.words.empty()) return values.words.front();
  return values.paths == cli::Paths::kNone ? "1" : "nowhere";
}

/// The command finds nothing to work on.
cli::Arguments arguments_for(const cli::CommandLine& line) {
  std::istringstream verbs(line.command.substr(sizeof "revisit"));
  cli::Arguments arguments(std::istream_iterator<std::string>(verbs), {});
  arguments.insert(arguments.end(), line.arguments.size(), "nowhere");
  return arguments;
}

void expect_renamed(const cli::Arguments& command, const std::string& former,
                    const std::string& now, const std::string& warning) {
  const test::TempDir dir;
  const auto error = [&](const std::string& option) {
    cli::Arguments arguments = command;
    arguments.insert(arguments.end(), {option, option});
    return error_of(arguments, dir.path());
  };
  const std::string without = error(now);
  EXPECT_EQ(without.find("deprecated"), std::string::npos) << without;
  EXPECT_EQ(without.find("unrecognized"), std::string::npos) << without;
  EXPECT_EQ(error(former), "warning: " + warning + "\n" + without) << command[0];
}

TEST(Help, FormerNamesWorkWithOneWarningAndAreHidden) {
  std::set<std::string> tried;
  for (const cli::CommandLine& line : commands())
    for (const cli::CommandLine::Option& option : line.options) {
      const std::string value = option.value ? "=" + value_of(*option.value) : "";
      for (const std::string& former : cli::former_options(line.command, option.name)) {
        tried.insert(former);
        EXPECT_EQ(std::ranges::count(line.options, former, &cli::CommandLine::Option::name), 0);
        expect_renamed(arguments_for(line), "--" + former + value, "--" + option.name + value,
                       "--" + former + " is deprecated, use --" + option.name);
      }
      for (const cli::Renamed& one : cli::renamed_values()) {
        if (one.where != option.name) continue;
        const std::string former = str(one.former), now = str(one.now);
        tried.insert(former);
        EXPECT_EQ(std::ranges::count(option.value->words, former), 0);
        EXPECT_EQ(std::ranges::count(option.value->words, now), 1);
        expect_renamed(
            arguments_for(line), "--" + option.name + "=" + former, "--" + option.name + "=" + now,
            str("--", option.name, " ", former, " is deprecated, use --", option.name, " ", now));
      }
    }
  EXPECT_EQ(tried.size(), cli::renamed_options().size() + cli::renamed_values().size());
}

TEST(Help, FormerCommandsWorkWithAWarningAndAreHidden) {
  const test::TempDir dir;
  for (const cli::Renamed& one : cli::renamed_commands()) {
    const std::string program(one.where), former(one.former), now(one.now);
    const std::string parents = program == "revisit" ? "" : program.substr(sizeof "revisit") + " ";
    const auto help = test::run_revisit(parents + "--help").out;
    EXPECT_NE(help.find("\n  " + now + " "), std::string::npos) << help;
    EXPECT_EQ(help.find("\n  " + former + " "), std::string::npos) << help;
    const auto by_former = test::run_revisit(parents + former + " --help"),
               by_now = test::run_revisit(parents + now + " --help");
    EXPECT_EQ(by_former.out, by_now.out);
    EXPECT_EQ(by_former.exit_code, 0);
    EXPECT_EQ(by_now.err, "");
    EXPECT_EQ(by_former.err, str("warning: ", program, " ", former, " is deprecated, use ", program,
                                 " ", now, "\n"));
    for (const cli::CommandLine& line : commands()) EXPECT_NE(line.command, program + " " + former);
  }
}

TEST(Help, ListsNoOptionThatTheCommandRefuses) {
  const test::TempDir dir;  // empty: commands end after parsing
  int options = 0, answered = 0;
  for (const cli::CommandLine& line : commands()) {
    const cli::Arguments command = arguments_for(line);
    for (const cli::CommandLine::Option& option : line.options) {
      cli::Arguments arguments = command;
      arguments.push_back("--" + option.name);
      if (option.value) arguments.back() += "=" + value_of(*option.value);
      std::string error = error_of(arguments, dir.path());
      static const std::regex kFeature("belongs to --feature ([a-z-]+)");
      std::smatch feature;
      if (std::regex_search(error, feature, kFeature)) {
        arguments.push_back("--feature=" + feature[1].str());
        error = error_of(arguments, dir.path());
      }
      static const std::regex kRefused(
          "unrecognized|belongs to|leave it out|unsupported|not supported|all of them at once");
      EXPECT_FALSE(std::regex_search(error, kRefused))
          << line.command << " " << arguments.back() << ": " << error;
      ++options;
      answered += error.empty() ? 0 : 1;
    }
  }
  EXPECT_GT(options, 200);
  EXPECT_GT(answered, options / 2);  // most commands miss their files
}

}  // namespace
}  // namespace revisit
