#pragma once

#include <optional>
#include <string>

#include "testing.h"

namespace revisit::test {

/// Runs the program in a folder per suite; `Suite::fill()` fills it once.
template <class Suite>
class ProgramTest : public testing::Test {
 protected:
  static void SetUpTestSuite() {
    folder_.emplace();
    Suite::fill();
  }
  static void TearDownTestSuite() { folder_.reset(); }

  static std::string path(const std::string& name) { return (*folder_ / name).string(); }
  static ProgramResult result_of(const std::string& command, int expected) {
    ProgramResult result = run_revisit(command);
    EXPECT_EQ(result.exit_code, expected) << command << "\n" << result.err;
    return result;
  }
  static std::string run(const std::string& command, int expected = 0) {
    const ProgramResult result = result_of(command, expected);
    return result.out + result.err;
  }

  inline static std::optional<TempDir> folder_;
};

}  // namespace revisit::test
