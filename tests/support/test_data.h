#pragma once

#include <filesystem>
#include <string>

namespace revisit::test {

/// Path in `REVISIT_TEST_DATA`, or in `../shared` beside the project; empty if absent.
std::filesystem::path shared(const std::string& relative);

/// Path in `tests/fixtures/`.
std::filesystem::path fixture(const std::string& relative);

/// Path in `tests/golden/`, outputs of the original Caffe: zoo, formats, parse.
std::filesystem::path golden(const std::string& relative);

/// Path from the project's root.
std::filesystem::path project_file(const std::string& relative);

/// Empty folder of the running test; removed at the end.
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

/// Creates parent folders.
void write_file(const std::filesystem::path& file, const std::string& content);
std::string read_file(const std::filesystem::path& file);

struct ProgramResult {
  int exit_code = -1;  // 128 + n when signal n ended it
  std::string out, err;
};
/// `arguments` is a shell-quoted string, e.g. "gt data --sequence 00".
ProgramResult run_revisit(const std::string& arguments, const std::string& environment = "");

}  // namespace revisit::test

/// Skips the running test if shared data is absent; else `variable` is its path.
#define REVISIT_NEED_SHARED(variable, relative)                             \
  const std::filesystem::path variable = ::revisit::test::shared(relative); \
  if (variable.empty())                                                     \
  GTEST_SKIP() << "shared test data absent: " << (relative)                 \
               << " (put it in ../shared or set REVISIT_TEST_DATA)"
