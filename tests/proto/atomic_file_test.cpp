#include "revisit/proto/atomic_file.h"

#include <gtest/gtest.h>

#include "expect_error.h"
#include "test_data.h"

namespace revisit {
namespace {

namespace fs = std::filesystem;

size_t n_files(const fs::path& folder) {
  return static_cast<size_t>(
      std::distance(fs::directory_iterator(folder), fs::directory_iterator()));
}

TEST(WriteAtomically, ReplacesTheWholeFileAndLeavesNothingElse) {
  const test::TempDir dir;
  test::write_file(dir / "f", "old and longer");
  write_atomically(dir / "f", [](std::ostream& out) { out << "new"; });
  EXPECT_EQ(test::read_file(dir / "f"), "new");
  EXPECT_EQ(n_files(dir.path()), 1U);
}

TEST(WriteAtomically, KeepsTheOldFileWhenWritingFails) {
  const test::TempDir dir;
  test::write_file(dir / "f", "old");
  EXPECT_THROW(write_atomically(dir / "f",
                                [](std::ostream& out) {
                                  out << "half";
                                  throw std::runtime_error("stopped");
                                }),
               std::runtime_error);
  const auto fail = [](std::ostream& out) { out.setstate(std::ios::badbit); };
  EXPECT_NE(
      test::message_of<Error>([&] { write_atomically(dir / "f", fail); }).find("cannot write"),
      std::string::npos);
  EXPECT_EQ(test::read_file(dir / "f"), "old");
  EXPECT_EQ(n_files(dir.path()), 1U);
}

TEST(WriteAtomically, NamesTheFileAndTheReason) {
  const test::TempDir dir;
  const fs::path file = dir.path() / "none" / "f";
  EXPECT_EQ(test::message_of<Error>([&] { write_atomically(file, [](std::ostream&) {}); }),
            file.string() + ": cannot create: No such file or directory");
}

}  // namespace
}  // namespace revisit
