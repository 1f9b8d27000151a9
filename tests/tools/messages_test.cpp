#include "cli/messages.h"

#include <gtest/gtest.h>

#include <fstream>
#include <regex>
#include <set>

#include "test_data.h"

namespace revisit::cli {
namespace {

namespace fs = std::filesystem;

struct Literal {
  std::string place, text;
};

std::vector<Literal> library_strings() {
  std::vector<Literal> strings;
  const std::regex literal(R"re("((?:[^"\\]|\\.)*)")re");
  for (const char* folder : {"proto", "engine", "pipeline", "weights_conversion"}) {
    for (const auto& entry : fs::recursive_directory_iterator(test::project_file(folder))) {
      const std::string ending = entry.path().extension();
      if (ending != ".cpp" && ending != ".h") continue;
      std::ifstream in(entry.path());
      std::string line;
      for (int n = 1; std::getline(in, line); ++n) {
        const size_t start = line.find_first_not_of(' ');
        if (start == std::string::npos || line.compare(start, 2, "//") == 0 ||
            line.compare(start, 8, "#include") == 0)
          continue;
        for (size_t at; (at = line.find("'\"'")) != std::string::npos;) line.erase(at, 3);
        for (std::sregex_iterator at(line.begin(), line.end(), literal), end; at != end; ++at)
          strings.push_back({entry.path().string() + ":" + std::to_string(n), (*at)[1]});
      }
    }
  }
  return strings;
}

TEST(Messages, LibrariesNameNoFlagAndNoCommandOfTheProgram) {
  const std::regex flag("(^|[^-A-Za-z0-9])--[a-z]"), command("[`']revisit ");
  const std::vector<Literal> strings = library_strings();
  EXPECT_GT(strings.size(), 1000U);
  for (const auto& [place, text] : strings) {
    EXPECT_FALSE(std::regex_search(text, flag)) << place << ": " << text;
    EXPECT_FALSE(std::regex_search(text, command)) << place << ": " << text;
  }
}

TEST(Messages, EveryCppNameInLibrariesHasAWordHere) {
  std::set<std::string> known, unused;
  for (const ProgramName& name : names_in_messages()) known.emplace(name.cpp);
  unused = known;
  const std::regex cpp_name(R"([A-Za-z_]+::[A-Za-z_]+)");
  for (const auto& [place, text] : library_strings()) {
    if (!std::regex_search(text, cpp_name)) continue;
    EXPECT_TRUE(known.contains(text)) << place << ": not a CppName, or without a word: " << text;
    unused.erase(text);
  }
  for (const std::string& name : unused) ADD_FAILURE() << "in no message any more: " << name;
}

TEST(Messages, TheWordsAreFlagsAndCommandsThatThereAre) {
  std::string help;
  for (const char* command : {"net inspect", "net layers", "eval", "train", "loops", "simulate",
                              "robustness", "models list"}) {
    const auto result = test::run_revisit(std::string(command) + " --help=all");
    EXPECT_EQ(result.exit_code, 0) << command;
    help += "'revisit " + std::string(command) + "'" + result.out;
  }
  for (const auto& [cpp, here] : names_in_messages()) {
    const std::string word = here;
    EXPECT_NE(help.find(word.substr(0, word.starts_with("--") ? word.find(' ') : word.size())),
              std::string::npos)
        << cpp << " -> " << here;
  }
}

TEST(Messages, CppNamesBecomeFlagsButTextStays) {
  const UsageError error("Truncation::end", ": ", CppName{"Truncation::end"}, " is not ",
                         CppName{"of::here"});
  EXPECT_EQ(message_of(error), "Truncation::end: --end is not of::here");
  EXPECT_STREQ(error.what(), "Truncation::end: Truncation::end is not of::here");
  EXPECT_EQ(message_of(InputError("Truncation::end: is empty")), "Truncation::end: is empty");
}

}  // namespace
}  // namespace revisit::cli
