#include <fcntl.h>
#include <gtest/gtest.h>
#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

#include <filesystem>
#include <iostream>
#include <iterator>
#include <regex>
#include <sstream>

#include "cli/command.h"
#include "cli/command_line.h"
#include "cli/messages.h"
#include "test_data.h"

namespace revisit {
namespace {

TEST(Help, ListsNothingHidden) {
  const std::string help = test::run_revisit("--help").out;
  EXPECT_EQ(help.find("completion"), std::string::npos) << help;
  EXPECT_NE(help.find("Exit codes: 0 ok; 1 failed;"), std::string::npos) << help;
}

/// The error of a command, which a child of this process runs in `folder`, with a second of
/// processor time: the program takes too long to start for hundreds of options.
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

/// A value of the kind that is asked for.
std::string value_of(const cli::Values& values) {
  if (!values.words.empty()) return values.words.front();
  return values.paths == cli::Paths::kNone ? "1" : "nowhere";
}

TEST(Help, ListsNoOptionThatTheCommandRefuses) {
  const test::TempDir dir;  // there is nothing to work on: commands end once they know what to do
  int options = 0, answered = 0;
  for (const cli::CommandLine& line : cli::all_of(cli::describe(cli::revisit_command))) {
    if (!line.below.empty()) continue;
    std::istringstream verbs(line.command.substr(sizeof "revisit"));
    cli::Arguments command(std::istream_iterator<std::string>(verbs), {});
    command.insert(command.end(), line.arguments.size(), "nowhere");
    for (const cli::CommandLine::Option& option : line.options) {
      cli::Arguments arguments = command;
      arguments.push_back("--" + option.name);
      if (option.value) arguments.back() += "=" + value_of(*option.value);
      std::string error = error_of(arguments, dir.path());
      // An option of another feature is for that one.
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
  EXPECT_GT(answered, options / 2);  // most commands miss what is nowhere
}

}  // namespace
}  // namespace revisit
