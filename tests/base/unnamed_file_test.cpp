#include <sys/wait.h>
#include <unistd.h>

#include "revisit/base/files.h"
#include "testing.h"

namespace revisit {
namespace {

TEST(UnnamedFile, ReturnsAppendedBytesAndLeavesNoFile) {
  const TempDir dir;
  const char* const before = std::getenv("TMPDIR");
  const std::string kept = before != nullptr ? before : "";
  ::setenv("TMPDIR", dir.path().c_str(), 1);
  UnnamedFile file;
  before != nullptr ? ::setenv("TMPDIR", kept.c_str(), 1) : ::unsetenv("TMPDIR");
  EXPECT_TRUE(std::filesystem::is_empty(dir.path()));
  const std::string first = "one", second(100'000, 'x');
  EXPECT_EQ(file.append(std::as_bytes(std::span(first))), 0);
  EXPECT_EQ(file.append(std::as_bytes(std::span(second))), 3);
  std::string read(4, '\0');
  file.read(1, std::as_writable_bytes(std::span(read)));
  EXPECT_EQ(read, "nexx");
  expect_error<Error>([&] { file.read(100'000, std::as_writable_bytes(std::span(read))); },
                      {"unexpected end of file"});
}

TEST(UnnamedFile, IsReadByAForkedProcessButNotWritten) {
  UnnamedFile file;
  const std::string bytes = "bytes";
  file.append(std::as_bytes(std::span(bytes)));
  const pid_t child = ::fork();
  if (child == 0) {
    std::string read(5, '\0');
    file.read(0, std::as_writable_bytes(std::span(read)));
    try {
      file.append(std::as_bytes(std::span(bytes)));
    } catch (const Error&) {
      ::_exit(read == bytes ? 0 : 2);
    }
    ::_exit(1);
  }
  int status = 0;
  ASSERT_EQ(::waitpid(child, &status, 0), child);
  EXPECT_EQ(status, 0);
}

}  // namespace
}  // namespace revisit
