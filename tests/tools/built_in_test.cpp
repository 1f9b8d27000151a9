#include "revisit/recognition/optional_library.h"
#include "small_drive.h"
#include "testing.h"

namespace revisit {
namespace {

constexpr const char* kServer = "'postgresql://nobody@127.0.0.1:1/none?map=m&patience=0'";

struct Need {
  std::string command;  // DATA, OUT and SERVER stand for a drive, a folder, and kServer
  std::string library;
  std::string option;
};

const std::vector<Need>& needs() {
  static const std::vector<Need> list = [] {
    std::vector<Need> needs = {
        {"eval DATA --feature fabmap --descriptors OUT/described", "OpenCV", "--feature fabmap"},
        {"loops DATA --feature m2dp --candidates 10 -o OUT/loops.csv", "FAISS", "--candidates"},
        {"locate OUT/a.map DATA --feature m2dp --candidates 10", "FAISS", "--candidates"},
        {"loops DATA --map SERVER -o OUT/loops.csv", "libpq", "--map"},
        {"loops DATA --map OUT/town.map --projection-from SERVER", "libpq", "--projection-from"},
        {"map build DATA --map SERVER", "libpq", "--map"},
        {"locate SERVER scan.bin", "libpq", "locate"},
        {"map info SERVER", "libpq", "map info"},
        {"map merge OUT/a.map SERVER -o OUT/both.map", "libpq", "map merge"},
        {"map merge OUT/a.map OUT/b.map -o SERVER", "libpq", "--output"}};
    for (const char* feature : {"vfh", "esf", "grsd"}) {
      const std::string option = str("--feature ", feature);
      needs.push_back({"loops DATA -o OUT/loops.csv " + option, "PCL", option});
      needs.push_back({"eval DATA -o OUT/results " + option, "PCL", option});
    }
    return needs;
  }();
  return list;
}

std::string with(std::string command, const std::string& word, const std::string& value) {
  for (size_t at = 0; (at = command.find(word, at)) != std::string::npos; at += value.size())
    command.replace(at, word.size(), value);
  return command;
}

TEST(BuiltIn, FeaturesOfAbsentLibrariesAreRejectedBeforeAnyWork) {
  const TempDir dir;
  write_small_drive(dir / "drive", 6);
  fs::create_directory(dir / "out");
  for (const Need& need : needs()) {
    const bool built_in = optional_library(need.library).built_in;
    // With the library, the command fails later: the drive is missing.
    const fs::path data = built_in ? dir / "none" : dir / "drive";
    std::string command = with(need.command, "DATA", data.string());
    command = with(with(command, "OUT", (dir / "out").string()), "SERVER", kServer);
    const auto result = run_revisit(command);
    const std::string rejection =
        need.option + ": this program was built without " + need.library + "; `tools/build.sh`";
    if (built_in) {
      EXPECT_NE(result.exit_code, 0) << command;
      EXPECT_EQ(result.err.find("built without"), std::string::npos) << command << result.err;
      continue;
    }
    EXPECT_EQ(result.exit_code, 2) << command << "\n" << result.err;
    EXPECT_HAS(result.err, rejection) << command;
    EXPECT_EQ(result.out, "") << command;
    EXPECT_TRUE(fs::is_empty(dir / "out")) << command;
  }
}

TEST(BuiltIn, TheTableHasEveryOptionalLibrary) {
  for (const OptionalLibrary& library : optional_libraries())
    EXPECT_TRUE(std::ranges::count(needs(), library.name, &Need::library)) << library.name;
}

TEST(BuiltIn, VersionListsLibraries) {
  const std::string version = run_revisit("--version").out;
  EXPECT_TRUE(version.starts_with("revisit " REVISIT_VERSION "\nbuilt in: ")) << version;
  const std::string line = version.substr(0, version.find('\n', version.find("built in: ")));
  bool complete = true;
  for (const OptionalLibrary& library : optional_libraries()) {
    complete &= library.built_in;
    EXPECT_EQ(line.find(library.name) != std::string::npos, library.built_in) << version;
    EXPECT_EQ(version.find(str("not built in: ", library.name, " (")) == std::string::npos,
              library.built_in)
        << version;
  }
  EXPECT_EQ(version.find("tools/build.sh") == std::string::npos, complete) << version;
}

}  // namespace
}  // namespace revisit
