#include "revisit/base/nameless_file.h"

#include <gtest/gtest.h>

#include <cstdlib>
#include <filesystem>
#include <string>

#include "expect_error.h"
#include "revisit/base/error.h"
#include "test_data.h"

namespace revisit {
namespace {

TEST(NamelessFile, ReturnsWhatWasAppendedAndLeavesNothing) {
  const test::TempDir dir;
  const char* const before = std::getenv("TMPDIR");
  const std::string kept = before != nullptr ? before : "";
  ::setenv("TMPDIR", dir.path().c_str(), 1);
  NamelessFile file;
  before != nullptr ? ::setenv("TMPDIR", kept.c_str(), 1) : ::unsetenv("TMPDIR");
  EXPECT_TRUE(std::filesystem::is_empty(dir.path()));
  const std::string first = "one", second(100'000, 'x');
  EXPECT_EQ(file.append(std::as_bytes(std::span(first))), 0);
  EXPECT_EQ(file.append(std::as_bytes(std::span(second))), 3);
  std::string read(4, '\0');
  file.read(1, std::as_writable_bytes(std::span(read)));
  EXPECT_EQ(read, "nexx");
  test::expect_error<Error>([&] { file.read(100'000, std::as_writable_bytes(std::span(read))); },
                            {"ends too early"});
}

}  // namespace
}  // namespace revisit
