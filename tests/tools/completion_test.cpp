#include "help/completion.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <regex>
#include <set>
#include <sstream>

#include "cli/shell.h"
#include "help/whole_program.h"
#include "revisit/base/error.h"
#include "test_data.h"

namespace revisit::help {
namespace {

using Words = std::vector<std::string>;

bool is_installed(const std::string& program) {
  return std::system(("command -v " + program + " >/dev/null 2>&1").c_str()) == 0;
}

/// As readline takes a line apart: = and : are words of their own.
Words taken_apart(const std::string& line) {
  Words words;
  std::istringstream in(line);
  for (std::string word; in >> word;) {
    for (size_t at; (at = word.find_first_of("=:")) != std::string::npos;) {
      if (at > 0) words.push_back(word.substr(0, at));
      words.push_back(word.substr(at, 1));
      word.erase(0, at + 1);
    }
    if (!word.empty()) words.push_back(word);
  }
  if (line.ends_with(' ')) words.emplace_back();
  return words;
}

class Bash : public testing::Test {
 protected:
  Bash() {
    const auto script = test::run_revisit("completion bash");
    EXPECT_EQ(script.exit_code, 0) << script.err;
    test::write_file(dir_ / "script", script.out);
    test::write_file(dir_ / "here/a.map", "");
    test::write_file(dir_ / "here/a folder/file", "");
  }

  /// What a tab behind `line` offers, sorted.
  Words offered(const std::string& line) const {
    const Words words = taken_apart(line);
    std::string program = "set -eu\nsource " + (dir_ / "script").string() + "\ncd " +
                          (dir_ / "here").string() + "\nCOMP_WORDS=(";
    for (const std::string& word : words) program += cli::shell_word(word) + " ";
    program +=
        str(") COMP_CWORD=", words.size() - 1,
            "\nset +e\n_revisit\nfor reply in \"${COMPREPLY[@]}\"; do echo \"$reply\"; done\n");
    test::write_file(dir_ / "program", program);
    const std::string out = (dir_ / "out").string();
    EXPECT_EQ(std::system(("bash " + (dir_ / "program").string() + " > " + out + " 2>&1").c_str()),
              0)
        << line << test::read_file(out);
    Words replies;
    std::istringstream lines(test::read_file(out));
    for (std::string reply; std::getline(lines, reply);) replies.push_back(reply);
    std::ranges::sort(replies);
    return replies;
  }

  test::TempDir dir_;
};

TEST_F(Bash, CompletesCommandsAndOptions) {
  EXPECT_EQ(offered("revisit lo"), Words{"loops"});
  EXPECT_EQ(offered("revisit loops --se"), (Words{"--sensor", "--sequence"}));
  EXPECT_EQ(offered("revisit net "),
            (Words{"forward", "inspect", "layers", "profile", "upgrade", "verify"}));
  EXPECT_EQ(offered("revisit net ins"), Words{"inspect"});
  EXPECT_EQ(offered("revisit help net ins"), Words{"inspect"});
  EXPECT_EQ(offered("revisit net inspect --inp"), Words{"--input-shape"});
  EXPECT_EQ(offered("revisit nonsense --s"), Words{});
}

TEST_F(Bash, OptionsAndTheirValuesAreNoArguments) {
  EXPECT_EQ(offered("revisit net inspect --end net --fo"), Words{"--format"});
  EXPECT_EQ(offered("revisit loops --no-progress --map=m.map a.map -o out --fo"),
            (Words{"--follow", "--format"}));
  EXPECT_EQ(offered("revisit models fetch --models=x:y places_c"), Words{"places_cnds8"});
}

TEST_F(Bash, CompletesTheWordsOfValues) {
  EXPECT_EQ(offered("revisit loops --format "), (Words{"csv", "jsonl"}));
  EXPECT_EQ(offered("revisit loops --format=j"), Words{"jsonl"});
  EXPECT_EQ(offered("revisit loops --format="), (Words{"csv", "jsonl"}));
  EXPECT_EQ(offered("revisit loops --sensor hdl"), (Words{"hdl32", "hdl64"}));
  EXPECT_EQ(offered("revisit eval KITTI --feature sc"), Words{"scan-context"});
  EXPECT_EQ(offered("revisit eval KITTI --protocol li"), Words{"list"});
  EXPECT_EQ(offered("revisit gt KITTI --distance 3"), Words{"3d"});
  EXPECT_EQ(offered("revisit experiment al"), (Words{"alignment", "all"}));
}

TEST_F(Bash, CompletesPathsWhereOneIsMeant) {
  EXPECT_EQ(offered("revisit loops --map a"), (Words{"a folder", "a.map"}));
  EXPECT_EQ(offered("revisit loops --map=a."), Words{"a.map"});
  EXPECT_EQ(offered("revisit loops --cache a"), Words{"a folder"});
  EXPECT_EQ(offered("revisit map query a."), Words{"a.map"});
  EXPECT_EQ(offered("revisit map query a.map x y a."), Words{"a.map"});
  EXPECT_EQ(offered("revisit eval --fit-on a"), (Words{"a folder", "all"}));
  EXPECT_EQ(offered("revisit eval --threads a"), Words{});
}

/// The long options in the list that argp prints.
std::set<std::string> options_of_help(const std::string& command) {
  const std::string text = test::run_revisit(command + " --help").out;
  const std::regex option(R"(\n +(?:-., )?(--[a-z0-9-]+))");
  std::set<std::string> options;
  for (std::sregex_iterator at(text.begin(), text.end(), option), end; at != end; ++at)
    options.insert((*at)[1]);
  return options;
}

TEST_F(Bash, EveryOptionThatHelpListsIsKnown) {
  int commands = 0;
  for (const cli::CommandLine& line : cli::all_of(whole_program())) {
    if (!line.below.empty()) continue;
    const Words words = offered(line.command + " --");
    EXPECT_EQ(std::set<std::string>(words.begin(), words.end()),
              options_of_help(line.command.substr(sizeof "revisit")))
        << line.command;
    ++commands;
  }
  EXPECT_GT(commands, 15);
}

TEST(Completion, OtherShellsTakeTheirScripts) {
  const test::TempDir dir;
  bool any = false;
  for (const auto& [shell, check] :
       {std::pair("zsh", "zsh -n "), std::pair("fish", "fish --no-execute ")}) {
    const auto script = test::run_revisit(str("completion ", shell));
    ASSERT_EQ(script.exit_code, 0) << script.err;
    for (const char* word : {"make-random", "ring-key-candidates", "scan-context"})
      EXPECT_NE(script.out.find(word), std::string::npos) << shell << " " << word;
    if (!is_installed(shell)) continue;
    any = true;
    test::write_file(dir / shell, script.out);
    const std::string said = (dir / "said").string();
    const int status =
        std::system((check + (dir / shell).string() + " > " + said + " 2>&1").c_str());
    EXPECT_EQ(status, 0) << shell << ": " << test::read_file(said);
    EXPECT_EQ(test::read_file(said), "") << shell;
  }
  if (!any) GTEST_SKIP() << "neither zsh nor fish is installed to read its script";
}

TEST(Completion, AShellThatIsNotKnownIsRefused) {
  const auto result = test::run_revisit("completion csh");
  EXPECT_EQ(result.exit_code, 2);
  EXPECT_NE(result.err.find("expected bash, zsh or fish, found 'csh'"), std::string::npos)
      << result.err;
}

TEST(Completion, DescriptionsAreCutAtAWord) {
  EXPECT_EQ(brief("as it is"), "as it is");
  const std::string cut = brief(std::string(60, 'a') + " bbb cccc dddd eeee");
  EXPECT_EQ(cut, std::string(60, 'a') + " bbb ...");
}

}  // namespace
}  // namespace revisit::help
