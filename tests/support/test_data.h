#pragma once

#include <filesystem>
#include <string>

namespace revisit::test {

/// A file or folder of the shared test data (`REVISIT_TEST_DATA`, or `../shared` beside the
/// project), or an empty path when it is absent.
std::filesystem::path shared(const std::string& relative);

/// A file of our own, `tests/fixtures/`.
std::filesystem::path fixture(const std::string& relative);

/// What the original Caffe computed for us, `tests/golden/`: zoo, formats, parse.
std::filesystem::path golden(const std::string& relative);

/// A file of the project itself, by its path from the root.
std::filesystem::path project_file(const std::string& relative);

/// An empty folder of the running test's own, removed at the end.
class TempDir {
 public:
  TempDir();
  ~TempDir();
  TempDir(const TempDir&) = delete;
  TempDir& operator=(const TempDir&) = delete;
  const std::filesystem::path& path() const { return path_; }
  std::filesystem::path operator/(const std::string& name) const { return path_ / name; }

 private:
  std::filesystem::path path_;
};

/// Writes `content` to `file` as it is; creates the folders above it.
void write_file(const std::filesystem::path& file, const std::string& content);
std::string read_file(const std::filesystem::path& file);

/// What a run of the `revisit` program gave.
struct ProgramResult {
  int exit_code = -1;  // 128 + n when signal n ended it
  std::string out, err;
};
/// Runs the built `revisit` with a shell-quoted argument string, e.g. "gt data --sequence 00".
ProgramResult run_revisit(const std::string& arguments, const std::string& environment = "");

}  // namespace revisit::test

/// Skips the running test, saying so, when shared data is absent; else `variable` is its path.
#define REVISIT_NEED_SHARED(variable, relative)                             \
  const std::filesystem::path variable = ::revisit::test::shared(relative); \
  if (variable.empty())                                                     \
  GTEST_SKIP() << "shared test data absent: " << (relative)                 \
               << " (put it in ../shared or set REVISIT_TEST_DATA)"
