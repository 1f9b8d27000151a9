#include "cli/parser.h"

#include <gtest/gtest.h>

#include <cstdlib>

namespace revisit::cli {
namespace {

std::vector<std::string> parts_of(const std::vector<std::string>& arguments) {
  std::vector<std::string> parts;
  Parser parser("test", "", "", "");
  parser.option("part", "P", "", &parts);
  parser.config([](const std::filesystem::path&) {
    return std::vector<std::pair<std::string, std::string>>{{"part", "f1"}, {"part", "f2"}};
  });
  parser.parse(arguments);
  return parts;
}

TEST(Parser, AListIsThatOfTheLastSourceThatHasOne) {
  using Parts = std::vector<std::string>;
  EXPECT_EQ(parts_of({"-c", "file"}), (Parts{"f1", "f2"}));
  ::setenv("REVISIT_PART", "e", 1);
  EXPECT_EQ(parts_of({"-c", "file"}), (Parts{"e"}));
  EXPECT_EQ(parts_of({"--part", "1", "--part", "2", "-c", "file"}), (Parts{"1", "2"}));
  EXPECT_EQ(parts_of({"--set", "part=s", "--set", "part=t"}), (Parts{"s", "t"}));
  ::unsetenv("REVISIT_PART");
}

}  // namespace
}  // namespace revisit::cli
