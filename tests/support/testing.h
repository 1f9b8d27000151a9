#pragma once

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <cfloat>
#include <chrono>
#include <cmath>
#include <csignal>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <ctime>
#include <filesystem>
#include <fstream>
#include <functional>
#include <initializer_list>
#include <iterator>
#include <limits>
#include <map>
#include <memory>
#include <numbers>
#include <numeric>
#include <optional>
#include <random>
#include <set>
#include <span>
#include <sstream>
#include <stdexcept>
#include <string>
#include <string_view>
#include <thread>
#include <tuple>
#include <utility>
#include <vector>

#include "revisit/base/error.h"

/// What every test uses. Tests call the helpers of revisit::test without a prefix.
namespace revisit {

namespace fs = std::filesystem;

namespace test {

/// Path in `REVISIT_TEST_DATA`, or in `../shared` beside the project; empty if absent.
fs::path shared(const std::string& relative);

/// Path in `tests/fixtures/`.
fs::path fixture(const std::string& relative);

/// Path in `tests/golden/`, outputs of the original Caffe: zoo, formats, parse.
fs::path golden(const std::string& relative);

/// Path from the project's root.
fs::path project_file(const std::string& relative);

/// Empty folder of the running test; removed at the end.
class TempDir {
 public:
  TempDir();
  ~TempDir();
  TempDir(const TempDir&) = delete;
  TempDir& operator=(const TempDir&) = delete;
  const fs::path& path() const { return path_; }
  fs::path operator/(const std::string& name) const { return path_ / name; }

 private:
  fs::path path_;
};

/// Creates parent folders.
void write_file(const fs::path& file, const std::string& content);
std::string read_file(const fs::path& file);

struct ProgramResult {
  int exit_code = -1;  // 128 + n when signal n ended it
  std::string out, err;
};
/// `arguments` is a shell-quoted string, e.g. "gt data --sequence 00".
ProgramResult run_revisit(const std::string& arguments, const std::string& environment = "");
/// Throws unless the program succeeds, which fails the test and ends it.
ProgramResult run_ok(const std::string& arguments, const std::string& environment = "");
/// The program must end with `exit_code`, and standard error must contain all `parts`.
void expect_exit(int exit_code, std::initializer_list<std::string> parts,
                 const std::string& arguments, const std::string& environment = "");

/// Returns the message; fails the test if `action` does not throw `Wanted`.
template <class Wanted, class Action>
std::string message_of(Action&& action) {
  try {
    action();
  } catch (const Wanted& error) {
    return error.what();
  } catch (const std::exception& error) {
    ADD_FAILURE() << "another kind of error: " << error.what();
    return "";
  }
  ADD_FAILURE() << "no error";
  return "";
}

/// The message must contain all `parts`.
template <class Wanted, class Action>
void expect_error(Action&& action, std::initializer_list<std::string> parts) {
  const std::string message = message_of<Wanted>(action);
  for (const std::string& part : parts)
    EXPECT_NE(message.find(part), std::string::npos) << "no \"" << part << "\" in: " << message;
}

/// Angles in radians.
constexpr double kPi = std::numbers::pi, kTurn = 2 * kPi, kDegree = kPi / 180;

/// max|a - b| / max|b|, as in tests/golden/README.md. Returns infinity if NaN or infinity differ.
inline double relative_error(std::span<const float> a, std::span<const float> b) {
  if (a.size() != b.size()) return INFINITY;
  double worst = 0, largest = 0;
  for (size_t i = 0; i < a.size(); ++i) {
    if (std::isfinite(a[i]) && std::isfinite(b[i])) {
      worst = std::max(worst, std::abs(static_cast<double>(a[i]) - b[i]));
      largest = std::max(largest, std::abs(static_cast<double>(b[i])));
    } else if (!(std::isnan(a[i]) && std::isnan(b[i])) && a[i] != b[i]) {
      return INFINITY;
    }
  }
  return largest > 0 ? worst / largest : worst;
}

}  // namespace test

using namespace test;

}  // namespace revisit

#define EXPECT_HAS(text, part) \
  EXPECT_NE((text).find(part), std::string::npos) << "'" << (text) << "' lacks '" << (part) << "'"

/// Skips the running test if shared data is absent; else `variable` is its path.
#define REVISIT_NEED_SHARED(variable, relative)                             \
  const std::filesystem::path variable = ::revisit::test::shared(relative); \
  if (variable.empty())                                                     \
  GTEST_SKIP() << "shared test data absent: " << (relative)                 \
               << " (put it in ../shared or set REVISIT_TEST_DATA)"
