#include <fcntl.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <sys/sysmacros.h>
#include <sys/un.h>
#include <sys/wait.h>
#include <unistd.h>

#include "revisit/base/files.h"
#include "testing.h"

namespace revisit {
namespace {

size_t n_files(const fs::path& folder) {
  return static_cast<size_t>(
      std::distance(fs::directory_iterator(folder), fs::directory_iterator()));
}

TEST(WriteAtomically, ReplacesTheWholeFileAndLeavesNothingElse) {
  const TempDir dir;
  write_file(dir / "f", "old and longer");
  write_atomically(dir / "f", [](std::ostream& out) { out << "new"; });
  EXPECT_EQ(read_file(dir / "f"), "new");
  EXPECT_EQ(n_files(dir.path()), 1U);
}

TEST(WriteAtomically, TheNewFileHasThePermissionsOfTheOld) {
  const TempDir dir;
  for (const mode_t mode : {0600, 0664, 0400}) {
    write_file(dir / "f", "old");
    ASSERT_EQ(::chmod((dir / "f").c_str(), mode), 0);
    write_atomically(dir / "f", [&](std::ostream& out) {
      out << "new";
      for (const auto& entry : fs::directory_iterator(dir.path()))
        EXPECT_EQ(entry.status().permissions(), fs::perms{mode}) << "private before";
    });
    EXPECT_EQ(read_file(dir / "f"), "new");
    EXPECT_EQ(fs::status(dir / "f").permissions(), fs::perms{mode});
    fs::remove(dir / "f");
  }
}

TEST(WriteAtomically, KeepsTheOldFileWhenWritingFails) {
  const TempDir dir;
  write_file(dir / "f", "old");
  EXPECT_THROW(write_atomically(dir / "f",
                                [](std::ostream& out) {
                                  out << "half";
                                  throw std::runtime_error("stopped");
                                }),
               std::runtime_error);
  const auto fail = [](std::ostream& out) { out.setstate(std::ios::badbit); };
  EXPECT_HAS(test::message_of<Error>([&] { write_atomically(dir / "f", fail); }), "cannot write");
  EXPECT_EQ(read_file(dir / "f"), "old");
  EXPECT_EQ(n_files(dir.path()), 1U);
}

TEST(WriteAtomically, NamesTheFileAndTheReason) {
  const TempDir dir;
  const fs::path file = dir.path() / "none" / "f";
  EXPECT_EQ(test::message_of<Error>([&] { write_atomically(file, [](std::ostream&) {}); }),
            file.string() + ": cannot create: No such file or directory");
}

void write_text(const fs::path& file, const std::string& text) {
  write_atomically(file, [&](std::ostream& out) { out << text; });
}

TEST(WriteAtomically, AFifoStaysOneAndIsWrittenTo) {
  const TempDir dir;
  const fs::path fifo = dir / "fifo";
  ASSERT_EQ(::mkfifo(fifo.c_str(), 0600), 0);
  const int keeper = ::open(fifo.c_str(), O_RDWR);  // keeps open() for reading from blocking
  std::ifstream in(fifo);
  EXPECT_FALSE(check_target(fifo));
  write_text(fifo, "bytes");
  EXPECT_TRUE(fs::is_fifo(fifo));
  ::close(keeper);
  EXPECT_EQ(std::string(std::istreambuf_iterator<char>(in), {}), "bytes");
  EXPECT_EQ(n_files(dir.path()), 1U);
}

/// Creates a device node in the test's folder, so that the machine's devices stay untouched.
bool make_device(const fs::path& file, unsigned minor) {
  return ::mknod(file.c_str(), S_IFCHR | 0666, ::makedev(1, minor)) == 0 &&
         ::access(file.c_str(), W_OK) == 0 && std::ofstream(file).is_open();
}

TEST(WriteAtomically, ADeviceStaysOneAndIsWrittenTo) {
  const TempDir dir;
  const fs::path null = dir / "null", full = dir / "full";
  if (!make_device(null, 3) || !make_device(full, 7))
    GTEST_SKIP() << "no devices can be made here (mknod needs root)";
  write_text(null, "bytes");
  EXPECT_TRUE(fs::is_character_file(null));
  EXPECT_EQ(test::message_of<Error>([&] { write_text(full, "bytes"); }),
            full.string() + ": cannot write: No space left on device");
  EXPECT_TRUE(fs::is_character_file(full));
  write_file(dir / "f", "x");
  for (const fs::path& device : {null, full})
    EXPECT_THROW(rename_into_place(dir / "f", device), Error);
  EXPECT_EQ(n_files(dir.path()), 3U);
}

TEST(WriteAtomically, RejectsPathsThatAreNoFile) {
  const TempDir dir;
  fs::create_directory(dir / "folder");
  const int descriptor = ::socket(AF_UNIX, SOCK_STREAM, 0);
  sockaddr_un address{AF_UNIX, {}};
  (dir / "socket").string().copy(address.sun_path, sizeof address.sun_path - 1);
  ASSERT_EQ(::bind(descriptor, reinterpret_cast<sockaddr*>(&address), sizeof address), 0);
  ::close(descriptor);
  fs::create_symlink("circle", dir / "circle");
  const std::pair<fs::path, const char*> refused[] = {{dir / "folder", "is a folder"},
                                                      {dir / "folder/", "names a folder"},
                                                      {dir / "socket", "is a socket"},
                                                      {dir / "circle", "too many symbolic links"}};
  for (const auto& [file, reason] : refused) {
    expect_error<UsageError>([&] { check_target(file); }, {file.string(), reason});
    expect_error<UsageError>([&] { write_text(file, ""); }, {file.string(), reason});
  }
  expect_error<Error>([&] { check_target(dir / "none/f"); }, {"there is no folder", "none"});
  write_file(dir / "f", "x");
  for (const char* name : {"folder", "socket"})
    EXPECT_THROW(rename_into_place(dir / "f", dir / name), Error) << name;
  EXPECT_EQ(n_files(dir.path()), 4U);
}

TEST(WriteAtomically, GoesThroughLinksToTheFileTheyName) {
  const TempDir dir;
  fs::create_directory(dir / "elsewhere");
  write_file(dir / "elsewhere/f", "old");
  fs::create_symlink("elsewhere/f", dir / "link");
  fs::create_symlink("link", dir / "link of a link");
  fs::create_symlink(dir / "elsewhere/new", dir / "dangling");
  write_text(dir / "link of a link", "new");
  write_text(dir / "dangling", "made");
  for (const char* link : {"link", "link of a link", "dangling"})
    EXPECT_TRUE(fs::is_symlink(dir / link)) << link;
  EXPECT_EQ(read_file(dir / "elsewhere/f"), "new");
  EXPECT_EQ(read_file(dir / "elsewhere/new"), "made");
}

TEST(WriteAtomically, StandardOutputGetsTheBytesWhereItStands) {
  const TempDir dir;
  const int before = ::dup(STDOUT_FILENO);
  const int descriptor = ::open((dir / "f").c_str(), O_RDWR | O_CREAT, 0600);
  ASSERT_EQ(::dup2(descriptor, STDOUT_FILENO), STDOUT_FILENO);
  EXPECT_EQ(::write(STDOUT_FILENO, "before ", 7), 7);
  fs::create_symlink("/proc/self/fd/1", dir / "out");
  write_text("/dev/stdout", "first ");
  write_text(dir / "out", "second ");
  EXPECT_EQ(::write(STDOUT_FILENO, "after", 5), 5);
  ASSERT_EQ(::dup2(before, STDOUT_FILENO), STDOUT_FILENO);
  ::close(before);
  ::close(descriptor);
  EXPECT_EQ(read_file(dir / "f"), "before first second after");
  EXPECT_EQ(n_files(dir.path()), 2U);
}

TEST(WriteAtomically, ThreadsAtOneTargetEachWriteAWholeFile) {
  const TempDir dir;
  const auto text_of = [](int thread) {
    return std::string(20'000, static_cast<char>('a' + thread));
  };
  std::vector<std::thread> threads;
  for (int i = 0; i < 8; ++i)
    threads.emplace_back([&, i] {
      for (int round = 0; round < 20; ++round)
        EXPECT_NO_THROW(write_atomically(dir / "f", [&](std::ostream& out) {
          const std::string text = text_of(i);
          out << text.substr(0, 10'000) << std::flush << text.substr(10'000);
        }));
    });
  for (std::thread& thread : threads) thread.join();
  const std::string text = read_file(dir / "f");
  ASSERT_EQ(text.size(), 20'000U);
  EXPECT_EQ(text, text_of(text[0] - 'a'));
  EXPECT_EQ(n_files(dir.path()), 1U);
}

TEST(WriteAtomically, AKilledWriterLeavesTheOldFile) {
  const TempDir dir;
  write_file(dir / "f", "old");
  const pid_t child = ::fork();
  if (child == 0) {
    write_atomically(dir / "f", [](std::ostream& out) {
      out << "half" << std::flush;
      ::_exit(0);
    });
  }
  ASSERT_EQ(::waitpid(child, nullptr, 0), child);
  EXPECT_EQ(read_file(dir / "f"), "old");
  EXPECT_EQ(n_files(dir.path()), 2U) << "nothing was half written, so that this shows nothing";
  write_text(dir / "f", "new");
  EXPECT_EQ(read_file(dir / "f"), "new");
}

}  // namespace
}  // namespace revisit
