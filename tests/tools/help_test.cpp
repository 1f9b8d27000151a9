#include <gtest/gtest.h>

#include <regex>

#include "cli/command_line.h"
#include "revisit/base/error.h"
#include "test_data.h"

namespace revisit {
namespace {

TEST(Help, ListsNothingHidden) {
  const std::string help = test::run_revisit("--help").out;
  EXPECT_EQ(help.find("completion"), std::string::npos) << help;
  EXPECT_NE(help.find("Exit codes: 0 ok; 1 failed;"), std::string::npos) << help;
}

/// A value of the kind that is asked for.
std::string value_of(const cli::Values& values) {
  if (!values.words.empty()) return values.words.front();
  return values.paths == cli::Paths::kNone ? "1" : "nowhere";
}

TEST(Help, ListsNoOptionThatTheCommandRefuses) {
  const test::TempDir dir;  // there is nothing to work on: commands end once they know what to do
  const std::string environment = "cd " + dir.path().string() + " && timeout 5";
  int options = 0;
  for (const cli::CommandLine& line : cli::all_of(cli::describe(cli::revisit_command))) {
    if (!line.below.empty()) continue;
    std::string command = line.command.substr(sizeof "revisit");
    for (size_t i = 0; i < line.arguments.size(); ++i) command += " nowhere";
    for (const cli::CommandLine::Option& option : line.options) {
      std::string text = " --" + option.name;
      if (option.value) text += "='" + value_of(*option.value) + "'";
      const auto said = [&](const std::string& more) {
        return test::run_revisit(command + text + more, environment).err;
      };
      std::string error = said("");
      // An option of another feature is for that one.
      static const std::regex kFeature("belongs to (--feature [a-z-]+)");
      std::smatch feature;
      if (std::regex_search(error, feature, kFeature)) {
        const std::string other = " " + feature[1].str();
        error = said(other);
      }
      static const std::regex kRefused(
          "unrecognized|belongs to|leave it out|unsupported|not supported|all of them at once");
      EXPECT_FALSE(std::regex_search(error, kRefused)) << command << text << ": " << error;
      ++options;
    }
  }
  EXPECT_GT(options, 200);
}

}  // namespace
}  // namespace revisit
