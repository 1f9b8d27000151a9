#include <regex>

#include "cli/command.h"
#include "cli/shell.h"
#include "testing.h"

namespace revisit {
namespace {

using Words = std::vector<std::string>;

/// Splits like readline: = and : are words of their own.
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
    const auto script = run_ok("--completion");
    write_file(dir_ / "script", script.out);
    write_file(dir_ / "here/a.map", "");
    write_file(dir_ / "here/a folder/file", "");
  }

  /// Sorted.
  Words offered(const std::string& line) const {
    const Words words = taken_apart(line);
    std::string program =
        str("PATH=", fs::path(REVISIT_PROGRAM).parent_path().string(), ":$PATH\nset -eu\nsource ") +
        (dir_ / "script").string() + "\ncd " + (dir_ / "here").string() + "\nCOMP_WORDS=(";
    for (const std::string& word : words) program += cli::shell_word(word) + " ";
    program +=
        str(") COMP_CWORD=", words.size() - 1,
            "\nset +e\n_revisit\nfor reply in \"${COMPREPLY[@]}\"; do echo \"$reply\"; done\n");
    write_file(dir_ / "program", program);
    const std::string out = (dir_ / "out").string();
    EXPECT_EQ(std::system(("bash " + (dir_ / "program").string() + " > " + out + " 2>&1").c_str()),
              0)
        << line << read_file(out);
    Words replies;
    std::istringstream lines(read_file(out));
    for (std::string reply; std::getline(lines, reply);) replies.push_back(reply);
    std::ranges::sort(replies);
    return replies;
  }

  TempDir dir_;
};

TEST_F(Bash, CompletesCommandsAndOptions) {
  EXPECT_EQ(offered("revisit lo"), (Words{"locate", "loops"}));
  EXPECT_EQ(offered("revisit loops --se"), (Words{"--sensor", "--sequence"}));
  EXPECT_EQ(offered("revisit net "), (Words{"forward", "inspect", "profile", "upgrade", "verify"}));
  EXPECT_EQ(offered("revisit net ins"), Words{"inspect"});
  EXPECT_EQ(offered("revisit help net ins"), Words{"inspect"});
  EXPECT_EQ(offered("revisit net inspect --inp"), Words{"--input-shape"});
  EXPECT_EQ(offered("revisit nonsense --s"), Words{});
}

TEST_F(Bash, OptionsAndTheirValuesAreNoArguments) {
  EXPECT_EQ(offered("revisit net inspect --end net --fo"), Words{"--format"});
  EXPECT_EQ(offered("revisit loops --quiet --map=m.map a.map -o out --fo"),
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
  EXPECT_EQ(offered("revisit eval KITTI --distance 3"), Words{"3d"});
  EXPECT_EQ(offered("revisit simulate --route=o"), Words{"opposite"});
}

TEST_F(Bash, CompletesPathsWhereOneIsMeant) {
  EXPECT_EQ(offered("revisit loops --map a"), (Words{"a folder", "a.map"}));
  EXPECT_EQ(offered("revisit loops --map=a."), Words{"a.map"});
  EXPECT_EQ(offered("revisit eval --cache a"), Words{"a folder"});
  EXPECT_EQ(offered("revisit locate a."), Words{"a.map"});
  EXPECT_EQ(offered("revisit locate a.map x y a."), Words{"a.map"});
  EXPECT_EQ(offered("revisit eval --pca a"), (Words{"a folder", "all"}));
  EXPECT_EQ(offered("revisit eval --threads a"), Words{});
  EXPECT_EQ(offered("revisit simulate -o a"), Words{"a folder"});
}

std::set<std::string> options_of_help(const std::string& command) {
  const std::string text = run_revisit(command + " --help=all").out;
  const std::regex option(R"(\n +(?:-., )?(--[a-z0-9-]+))");
  std::set<std::string> options;
  for (std::sregex_iterator at(text.begin(), text.end(), option), end; at != end; ++at)
    options.insert((*at)[1]);
  return options;
}

TEST_F(Bash, EveryOptionThatHelpListsIsKnown) {
  int commands = 0;
  cli::for_each_command(cli::revisit_program(), "revisit",
                        [&](const cli::Command& command, const auto& options) {
                          if (!command.below.empty()) return;
                          const Words words = offered(options.command() + " --");
                          EXPECT_EQ(std::set<std::string>(words.begin(), words.end()),
                                    options_of_help(options.command().substr(sizeof "revisit")))
                              << options.command();
                          ++commands;
                        });
  EXPECT_GT(commands, 15);
}

TEST_F(Bash, ZshTakesTheScriptByBashcompinit) {
  if (std::system("command -v zsh >/dev/null 2>&1") != 0) GTEST_SKIP() << "zsh is not installed";
  const auto in_zsh = [&](const std::string& line) {
    const std::string out = (dir_ / "out").string();
    write_file(dir_ / "program",
               "autoload -Uz compinit bashcompinit\ncompinit -D -u\nbashcompinit\nsource " +
                   (dir_ / "script").string() + "\nCOMP_WORDS=(" + line +
                   ")\nwords=($COMP_WORDS) PREFIX=$words[-1]\n"
                   "((CURRENT = $#words, COMP_CWORD = CURRENT - 1))\n"
                   "compgen -F _revisit -- $PREFIX\n");
    EXPECT_EQ(std::system(("cd " + (dir_ / "here").string() + " && zsh -f " +
                           (dir_ / "program").string() + " > " + out + " 2>&1")
                              .c_str()),
              0);
    return "\n" + read_file(out);
  };
  // zsh itself drops words without the typed prefix.
  for (const auto& [line, reply] :
       {std::pair("revisit loo", "loops"), std::pair("revisit net ins", "inspect"),
        std::pair("revisit loops --se", "--sequence"),
        std::pair("revisit loops --format j", "jsonl"),
        std::pair("revisit loops --format=j", "--format=jsonl"),
        std::pair("revisit loops --map a", "a.map")})
    EXPECT_HAS(in_zsh(line), str("\n", reply, "\n")) << line;
}

}  // namespace
}  // namespace revisit
