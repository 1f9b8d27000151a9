#include <gtest/gtest.h>

#include <cstdlib>

#include "help/man_page.h"
#include "help/whole_program.h"
#include "revisit/base/error.h"
#include "test_data.h"

namespace revisit::help {
namespace {

/// A page as a terminal shows it, in one line; what groff says besides is a fault.
std::string formatted(const std::string& page) {
  const test::TempDir dir;
  test::write_file(dir / "page", page);
  const std::string command =
      str("cd ", dir.path().string(),
          " && GROFF_NO_SGR=1 groff -ww -man -Tutf8 -P-cbou page > text 2> said");
  EXPECT_EQ(std::system(command.c_str()), 0);
  EXPECT_EQ(test::read_file(dir / "said"), "");
  std::string words;
  for (const char c : test::read_file(dir / "text"))
    if (c != '\n' && c != ' ')
      words += c;
    else if (!words.ends_with(' '))
      words += ' ';
  return words;
}

class Pages : public testing::Test {
 protected:
  void SetUp() override {
    if (std::system("command -v groff >/dev/null 2>&1") != 0)
      GTEST_SKIP() << "groff is not installed to read the pages (package groff-base)";
  }
};

TEST_F(Pages, EveryCommandHasOneWithAllOfItsOptions) {
  const cli::CommandLine program = whole_program();
  size_t options = 0;
  for (const cli::CommandLine& line : cli::all_of(program)) {
    const std::string page = formatted(man_page(line, program));
    EXPECT_NE(page.find(line.headline), std::string::npos) << line.command << page;
    EXPECT_FALSE(line.headline.empty()) << line.command;
    for (const cli::CommandLine::Option& option : line.options()) {
      std::string shown = "--" + option.name;
      if (option.value) shown += "=" + option.value->name;
      EXPECT_NE(page.find(" " + shown + " "), std::string::npos) << line.command << ": " << shown;
      ++options;
    }
  }
  EXPECT_GT(options, 200U);
}

TEST_F(Pages, TextComesOutAsItWentIn) {
  cli::CommandLine line;
  line.command = "revisit odd";
  line.headline = "odd signs";
  line.summary = ".SH no request\n'quoted' `back` ~/a^b\\n 3 - 4 --option";
  line.examples = "  revisit odd 'a b' > ~/x\n.y\n";
  line.groups = {{"", {{"all", 0, ".hidden", cli::Values{"a|b", {"a", "b", "other-word"}}, true}}}};
  const std::string page = formatted(man_page(line, line));
  for (const char* text :
       {".SH no request 'quoted' `back` ~/a^b\\n 3 - 4 --option", "revisit odd 'a b' > ~/x .y",
        ".hidden", "may be repeated", "Known: other-word."})
    EXPECT_NE(page.find(text), std::string::npos) << text << "\n" << page;
}

TEST(Man, WritesThePagesOfAllCommands) {
  const test::TempDir dir;
  const auto result = test::run_revisit("man --all " + (dir / "man1").string());
  ASSERT_EQ(result.exit_code, 0) << result.err;
  for (const auto& [page, command] : {std::pair("revisit.1", ""), std::pair("revisit-net.1", "net"),
                                      std::pair("revisit-net-inspect.1", "net inspect")})
    EXPECT_EQ(test::read_file(dir.path() / "man1" / page),
              test::run_revisit(std::string("man ") + command).out)
        << page;
  EXPECT_EQ(test::run_revisit("man net nonsense").exit_code, 2);
}

TEST(Man, HelpListsNothingHidden) {
  const std::string help = test::run_revisit("--help").out;
  EXPECT_EQ(help.find("completion"), std::string::npos) << help;
  EXPECT_NE(help.find("Exit codes: 0 ok; 1 failed;"), std::string::npos) << help;
}

}  // namespace
}  // namespace revisit::help
