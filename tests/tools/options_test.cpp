#include "cli/options.h"

#include <sys/stat.h>
#include <sys/sysmacros.h>
#include <sys/wait.h>

#include "cli/json.h"
#include "cli/terminal.h"
#include "eval/eval_options.h"
#include "reports.pb.h"
#include "testing.h"

namespace revisit::cli {
namespace {

std::vector<std::string> parts_of(const std::vector<std::string>& arguments) {
  std::vector<std::string> parts;
  Options options("test");
  options.option("part", "P", "", &parts);
  options.config([](const std::filesystem::path&) {
    return std::vector<std::pair<std::string, std::string>>{{"part", "f1"}, {"part", "f2"}};
  });
  options.parse(arguments);
  return parts;
}

TEST(Options, AListIsThatOfTheLastSourceThatHasOne) {
  using Parts = std::vector<std::string>;
  EXPECT_EQ(parts_of({"-c", "file"}), (Parts{"f1", "f2"}));
  ::setenv("REVISIT_PART", "e", 1);
  EXPECT_EQ(parts_of({"-c", "file"}), (Parts{"e"}));
  EXPECT_EQ(parts_of({"--part", "1", "--part", "2", "-c", "file"}), (Parts{"1", "2"}));
  ::unsetenv("REVISIT_PART");
}

TEST(Options, ThereIsOneConfigurationFile) {
  expect_error<UsageError>(
      [] {
        parts_of({"-c", "file", "--config", "other"});
      },
      {"--config: expected at most one", "file", "other"});
}

TEST(Options, AChoiceIsOneOfItsWords) {
  const auto chosen = [](const std::vector<std::string>& arguments) {
    std::optional<int> number;
    std::string word = "table";
    Options options("test");
    options.choice<int>("number", {{"one", 1}, {"two", 2}}, "", &number);
    options.choice("format", {"table", "json", "csv"}, "", &word);
    options.parse(arguments);
    EXPECT_EQ(options.given("number"), number.has_value());
    return std::pair(number.value_or(0), word);
  };
  EXPECT_EQ(chosen({}), std::pair(0, std::string("table")));
  EXPECT_EQ(chosen({"--number", "two", "--format=csv"}), std::pair(2, std::string("csv")));
  expect_error<UsageError>(
      [&] {
        chosen({"--format", "jsn"});
      },
      {"--format: expected table, json or csv, found 'jsn'", "'json'?"});
  expect_error<UsageError>(
      [&] {
        chosen({"--number", "three"});
      },
      {"--number: expected one or two, found 'three'"});
}

TEST(Options, ChecksBelongToRows) {
  const auto given = [](const std::vector<std::string>& arguments) {
    double share = 0.5;
    int count = 1;
    std::string map, file;
    std::vector<std::string> scans;
    Options options("test");
    options.argument("SCAN", &scans).optional();
    options.option("share", "P", "", &share).between(0, 1);
    options.option("count", "N", "", &count).at_least(1).needs("map");
    options.option("map", "FILE", "", &map).excludes({"share"});
    options.option("output", "FILE", "", &file, 'o').required();
    options.parse(arguments);
    return joined(scans, " ");
  };
  EXPECT_EQ(given({"a", "-o", "x", "--", "-b", "--", "c"}), "a -b -- c");
  EXPECT_EQ(given({"-ox", "[a,b]", "-"}), "[a,b] -");
  const std::pair<std::vector<std::string>, std::string> wrong[] = {
      {{}, "missing required option --output FILE"},
      {{"-o", "x", "--share", "2"}, "--share: expected 0 to 1, found 2"},
      {{"-o", "x", "--share", "-1"}, "--share: expected 0 to 1, found -1"},
      {{"-o", "x", "--count", "0"}, "--count: expected at least 1, found 0"},
      {{"-o", "x", "--count", "2"}, "--count: needs --map"},
      {{"-o", "x", "--map", "m", "--share", "1"}, "--map: not with --share; give one of the two"},
      {{"-o", "x", "--shar", "1"}, "unrecognized option '--shar' (did you mean '--share'?)"},
      {{"-o"}, "--output: 1 required FILE missing"}};
  for (const auto& [arguments, message] : wrong)
    expect_error<UsageError>([&, &line = arguments] { given(line); }, {message});
}

TEST(Options, RowsTellOfValuesBeforeTheyAreParsed) {
  std::optional<double> height;
  int count = 3;
  bool all = false;
  Options options("test");
  options.group("Data:").option("height", "M", "", &height).option("count", "N", "", &count);
  options.flag("all", "", &all).group("Running:", false).flag("quiet", "", &all);
  using Settings = std::vector<std::pair<std::string, std::string>>;
  EXPECT_EQ(options.settings(), (Settings{{"height", ""}, {"count", "3"}, {"all", ""}}));
  options.parse({"--height=1.5", "--all"});
  EXPECT_EQ(options.settings(), (Settings{{"height", "1.5"}, {"count", "3"}, {"all", "true"}}));
}

TEST(Progress, TheLineIsCutToTheTerminal) {
  EXPECT_EQ(redrawn("abcdef", 0, 0, false), "\r\033[Kabcdef");
  EXPECT_EQ(redrawn("abcdef", 9, 5, false), "\r\033[Kabcd");
  EXPECT_EQ(redrawn("abc", 6, 80, true), "\rabc   ");
  EXPECT_EQ(redrawn("abcdef", 2, 5, true), "\rabcd");
}

/// "REVISIT" in `command` stands for the program.
std::string shell(std::string command, int* code) {
  const TempDir dir;
  for (size_t at; (at = command.find("REVISIT")) != std::string::npos;)
    command.replace(at, 7, REVISIT_PROGRAM);
  command = "cd " + dir.path().string() + "; { " + command + "; } > output 2>&1";
  const int status = std::system(command.c_str());
  *code = WIFEXITED(status) ? WEXITSTATUS(status) : 128 + WTERMSIG(status);
  return read_file(dir / "output");
}

TEST(Program, HelpIsAFailureWhenItCannotBeWritten) {
  const TempDir dir;
  const std::string full = (dir / "full").string();
  if (::mknod(full.c_str(), S_IFCHR | 0666, ::makedev(1, 7)) != 0 || !std::ofstream(full).is_open())
    GTEST_SKIP() << "no device can be made here (mknod needs root)";
  for (const char* help : {"net inspect --help", "net inspect -h", "--help"}) {
    int code = 0;
    const std::string said = shell(str("REVISIT ", help, " > ", full), &code);
    EXPECT_EQ(code, 1) << help;
    EXPECT_HAS(said, "cannot write to standard output") << help;
  }
}

TEST(Program, ExamplesOfHelpAreOneLineACommand) {
  for (const char* command : {"net forward", "net inspect"}) {
    const auto result = run_ok(str(command, " --help"));
    const size_t examples = result.out.find("\nExamples:\n");
    ASSERT_NE(examples, std::string::npos) << result.out;
    std::istringstream lines(result.out.substr(examples + 11));
    for (std::string line; std::getline(lines, line) && !line.empty();)
      EXPECT_TRUE(line.starts_with("  revisit ")) << command << ": " << line;
  }
}

TEST(TextFiles, AreNoFifos) {
  const TempDir dir;
  ASSERT_EQ(::mkfifo((dir / "fifo").c_str(), 0600), 0);
  const std::string reason = "fifo: is not a regular file";
  expect_error<InputError>([&] { read_config_file(dir / "fifo"); }, {reason});
  reports::Run run;
  expect_error<InputError>([&] { read_report(dir / "fifo", &run); }, {reason});
}

TEST(TextFiles, BrokenJsonIsOneLineWithoutCodes) {
  const TempDir dir;
  write_file(dir / "m.json", "{\"tasks\": [");
  reports::Run run;
  const std::string message =
      test::message_of<InputError>([&] { read_report(dir / "m.json", &run); });
  EXPECT_EQ(message.find('\n'), std::string::npos) << message;
  EXPECT_EQ(message.find("INVALID"), std::string::npos) << message;
  EXPECT_HAS(message, "m.json: not the Run that revisit writes: Unexpected end");
}

TEST(Program, HelpAndVersionAsWords) {
  EXPECT_EQ(test::run_revisit("help net inspect").out, test::run_revisit("net inspect --help").out);
  EXPECT_EQ(test::run_revisit("version").out, test::run_revisit("--version").out);
  EXPECT_EQ(test::run_revisit("help nonsense").exit_code, 2);
}

TEST(Program, AFileBeyondTheLimitOfTheShellIsAnError) {
  int code = 0;
  const std::string said = shell("ulimit -f 8; REVISIT models make-random -o r", &code);
  EXPECT_EQ(code, 1) << said;
  EXPECT_HAS(said, "File too large");
}

}  // namespace
}  // namespace revisit::cli
