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

/// The string literals of the libraries' sources, each line's for itself.
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

TEST(Messages, EveryFieldThatLibrariesNameHasAWordHere) {
  std::set<std::string> known, unused;
  for (const Setting& setting : settings_in_messages()) known.insert(setting.field);
  unused = known;
  const std::regex field(R"([A-Za-z_]+::[A-Za-z_]+)");
  for (const auto& [place, text] : library_strings()) {
    for (std::sregex_iterator at(text.begin(), text.end(), field), end; at != end; ++at) {
      EXPECT_TRUE(known.contains(at->str())) << place << ": " << at->str() << " in: " << text;
      unused.erase(at->str());
    }
  }
  for (const std::string& name : unused) ADD_FAILURE() << "in no message any more: " << name;
}

TEST(Messages, TheWordsAreFlagsAndCommandsThatThereAre) {
  std::string help;
  for (const char* command : {"net inspect", "net layers", "eval", "learn", "loops", "simulate",
                              "robustness", "models list"}) {
    const auto result = test::run_revisit(std::string(command) + " --help");
    EXPECT_EQ(result.exit_code, 0) << command;
    help += "'revisit " + std::string(command) + "'" + result.out;
  }
  for (const auto& [field, here] : settings_in_messages()) {
    const std::string word = here;
    EXPECT_NE(help.find(word.substr(0, word.starts_with("--") ? word.find(' ') : word.size())),
              std::string::npos)
        << field << " -> " << here;
  }
}

TEST(Messages, FieldsBecomeFlags) {
  EXPECT_EQ(in_our_words("Truncation::graft needs Truncation::end: the layer; Truncation::end"),
            "--graft needs --end: the layer; --end");
  EXPECT_EQ(in_our_words("nothing: to::say"), "nothing: to::say");
}

}  // namespace
}  // namespace revisit::cli
