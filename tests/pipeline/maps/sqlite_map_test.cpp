#include <fcntl.h>
#include <sys/resource.h>
#include <sys/stat.h>
#include <unistd.h>

#include "execute_sql.h"
#include "map_entries.h"
#include "map_file.h"
#include "process.h"
#include "revisit/maps/map_store.h"
#include "sqlite_driver.h"
#include "testing.h"

namespace revisit {
namespace {

/// `work` may change its process for ever, and may fail expectations.
void in_another_process(const std::function<void()>& work) {
  EXPECT_TRUE(Process(work).succeeds());
}

void expect_no_writing(const fs::path& file, const char* part) {
  expect_error<Error>([&] { writer_of(file); }, {part});
}

void expect_rejected_map(const fs::path& file, std::initializer_list<std::string> parts) {
  for (const MapAccess access : {MapAccess::kRead, MapAccess::kWrite})
    expect_error<InputError>([&] { open_map(file, access); }, parts);
}

TEST(SqliteMap, GivesBackTheSpaceOfFeatures) {
  const TempDir dir;
  const fs::path file = dir / "a.map";
  MapEntry entry;
  for (int i = 0; i < 10'000; ++i) entry.feature.push_back(std::sin(static_cast<float>(i * i)));
  writer_of(file)->add(std::vector(20, entry));
  EXPECT_LT(fs::file_size(file), 20U * 20'000);
  writer_of(file)->replace_descriptors([](const MapEntry&) { return std::vector<float>{1}; }, {},
                                       0);
  EXPECT_LT(fs::file_size(file), 50'000);
}

TEST(SqliteMap, HasOneWriter) {
  const TempDir dir;
  const mode_t mask = ::umask(0);
  auto map = writer_of(dir / "map");
  ::umask(mask);
  map->add(made_entries(1, 20));
  reader_of(dir / "map");
  EXPECT_EQ(fs::status(dir / "map-writer").permissions(), fs::perms(0666));
  const auto open_files = [] {
    return std::distance(fs::directory_iterator("/proc/self/fd"), fs::directory_iterator());
  };
  const char* const kBusy = "map: another process is writing";
  // SQLite keeps one file descriptor, because closing it would release the writer's locks
  expect_no_writing(dir / "map", kBusy);
  const auto before = open_files();
  expect_no_writing(dir / "map", kBusy);
  writer_of(dir / "other");
  EXPECT_EQ(open_files(), before);
  in_another_process([&] {
    expect_no_writing(dir / "map", kBusy);
    ::close(0);
    writer_of(dir / "without standard input");
    // Another program may remove the log of a map without locks.
    const int file = ::open((dir / "map").c_str(), O_RDWR);
    struct flock lock {};
    lock.l_type = F_WRLCK;
    EXPECT_EQ(::fcntl(file, F_GETLK, &lock), 0);
    EXPECT_EQ(lock.l_type, F_RDLCK);
    map.reset();  // that of the parent
  });
  expect_no_writing(dir / "map", kBusy);
  fs::rename(dir / "map", dir / "moved");
  expect_error<Error>([&] { map->add(made_entries(21, 21)); }, {"map: the file was moved"});
  fs::rename(dir / "moved", dir / "map");
  map.reset();
  for (const char* other : {"map-wal", "map-shm", "map-writer"})
    EXPECT_FALSE(fs::exists(dir / other));
}

/// A process may open the lock file while another one, that ends, removes it.
TEST(SqliteMap, WriterLockIsHeldByOne) {
  const TempDir dir;
  std::atomic<int> inside = 0, together = 0;
  const auto compete = [&] {
    for (int won = 0; won < 100;) try {
        const auto lock = lock_writer(dir / "map", "map");
        if (++inside > 1) ++together;
        ++won;
        std::this_thread::yield();
        --inside;
      } catch (const Error&) {
      }
  };
  std::vector<std::thread> threads;
  for (int t = 0; t < 3; ++t) threads.emplace_back(compete);
  for (std::thread& thread : threads) thread.join();
  EXPECT_EQ(together, 0);
}

TEST(SqliteMap, RejectsOtherFiles) {
  const TempDir dir;
  expect_rejected_map(dir.path(), {"not a regular file"});
  write_file(dir / "empty", "");
  expect_rejected_map(dir / "empty", {"empty: not a map: the file is empty"});
  write_file(dir / "text", std::string(10'000, 'x'));
  expect_rejected_map(dir / "text", {"text: not a map"});
  expect_error<InputError>([&] { writer_of(dir / "text"); }, {"text: not a map"});
  EXPECT_EQ(read_file(dir / "text"), std::string(10'000, 'x'));
  execute_sql(dir / "db", "CREATE TABLE entry (id INTEGER PRIMARY KEY)");
  expect_rejected_map(dir / "db", {"db: "});
  EXPECT_EQ(check_map(dir / "db").size(), 1);
  expect_error<Error>([&] { writer_of(dir / "no/town.map"); },
                      {"no/town.map: cannot create: there is no folder ", "/no"});
  EXPECT_EQ(std::distance(fs::directory_iterator(dir.path()), fs::directory_iterator()), 3);
}

TEST(SqliteMap, RejectsOtherFilesBesideIt) {
  const TempDir dir;
  writer_of(dir / "map")->add(made_entries(1, 3));
  const auto rejected = [&](const std::string& name) {
    expect_rejected_map(dir / "map", {name, "move it away"});
    expect_error<InputError>([&] { check_map(dir / "map"); }, {name, "move it away"});
    fs::remove(dir / name);
  };
  for (const char* ending : {"-wal", "-shm", "-journal"}) {
    const std::string name = std::string("map") + ending;
    ASSERT_EQ(::mkfifo((dir / name).c_str(), 0600), 0);
    rejected(name);
    fs::create_directory(dir / name);
    rejected(name);
    fs::create_symlink("map", dir / name);
    rejected(name);
  }
  write_file(dir / "map-journal", "of another program");
  rejected("map-journal");
  write_file(dir / "precious", "of the user");
  fs::create_symlink("precious", dir / "map-writer");
  expect_no_writing(dir / "map", "map-writer");
  EXPECT_EQ(read_file(dir / "precious"), "of the user");
  fs::remove(dir / "map-writer");
  expect_entries(*writer_of(dir / "map"), 3);
  // A log without its map.
  write_file(dir / "new-wal", "of another program");
  expect_error<InputError>([&] { writer_of(dir / "new"); }, {"new-wal", "move it away"});
  EXPECT_FALSE(fs::exists(dir / "new"));
  EXPECT_EQ(read_file(dir / "new-wal"), "of another program");
}

/// A killed program leaves a log for the next process that opens the database, here a copy.
TEST(SqliteMap, LeavesLogsOfOtherProgramsUnchanged) {
  for (const char* mode : {"DELETE", "WAL"}) {
    SCOPED_TRACE(mode);
    const TempDir dir;
    fs::create_directory(dir / "copy");
    in_another_process([&] {
      SqliteDriver theirs(dir / "db", SQLITE_OPEN_READWRITE | SQLITE_OPEN_CREATE, "db");
      theirs.execute(std::string("PRAGMA journal_mode = ") + mode);
      theirs.execute("PRAGMA cache_size = 1");  // forces writes before the end of a transaction
      theirs.execute("CREATE TABLE t (x)");
      theirs.execute("INSERT INTO t VALUES (zeroblob(100000))");
      theirs.execute("BEGIN");
      theirs.execute("UPDATE t SET x = randomblob(200000)");
      fs::copy(dir.path(), dir / "copy");
    });
    const auto files = [&] {
      std::map<fs::path, std::string> contents;
      for (const auto& file : fs::directory_iterator(dir / "copy"))
        contents[file.path()] = read_file(file.path());
      return contents;
    };
    const auto before = files();
    ASSERT_GE(before.size(), 2);
    const fs::path file = dir / "copy/db";
    expect_rejected_map(file, {"db"});
    EXPECT_THROW(writer_of(file), InputError);
    EXPECT_THROW(open_map(file, MapAccess::kNew, &kFingerprint), InputError);
    EXPECT_TRUE(files() == before);
  }
}

TEST(SqliteMap, RejectsOrReportsTruncatedAndCorruptFiles) {
  const TempDir dir;
  constexpr size_t kEntries = 60;
  const std::set<int64_t> removed = {2, 5, 50};
  {
    const auto map = writer_of(dir / "map");
    map->set_value("threshold", "0.5");
    map->add(made_entries(1, kEntries));
    map->remove(std::vector(removed.begin(), removed.end()));
  }
  const std::string whole = read_file(dir / "map");
  std::mt19937 random(5);
  int rejected = 0, reported = 0;
  for (int i = 0; i < 540; ++i) {
    std::string bytes = whole;
    size_t at = random() % bytes.size();
    // Every second change near the beginning of a page, where the B-tree headers are.
    if (i % 2 == 0) at = std::min(bytes.size() - 1, at / 4096 * 4096 + random() % 120);
    if (i < 40)
      bytes.resize(std::max<size_t>(at, 1));
    else
      bytes[at] ^= static_cast<char>(1 + random() % 255);
    SCOPED_TRACE(str(i < 40 ? "truncated to " : "byte ", at));
    write_file(dir / "copy", bytes);
    bool is_noticed = true;
    try {
      const auto map = open_map(dir / "copy", MapAccess::kRead, &kFingerprint);
      const ReadMap read = read_all(*map);
      is_noticed = !read.problems.empty();
      reported += is_noticed ? 1 : 0;
      for (const MapEntry& entry : read.entries)
        EXPECT_TRUE(same(entry, made_entry("x", entry.id)) && !removed.contains(entry.id));
      EXPECT_TRUE(is_noticed || (read.entries.size() == kEntries - removed.size() &&
                                 map->removed() == std::vector(removed.begin(), removed.end())));
      EXPECT_EQ(map->value("threshold"), "0.5");
    } catch (const InputError& error) {
      EXPECT_HAS(std::string(error.what()), "copy: ");
      ++rejected;
    }
    EXPECT_TRUE((i >= 40 && !is_noticed) || !check_map(dir / "copy").empty());
  }
  EXPECT_GT(rejected, 60);
  EXPECT_GT(reported, 50);
}

/// SQLite ends a log at its first bad frame, as after a power failure.
TEST(SqliteMap, EndsCorruptLogsAtTheFirstBadFrame) {
  const TempDir dir;
  const fs::path file = dir / "map", log = dir / "map-wal";
  in_another_process([&] {
    auto map = writer_of(file);
    for (int64_t step = 0; step < 8; ++step) map->add(made_entries(3 * step + 1, 3 * step + 3));
    map.release();  // closing it would move the transactions to the file
  });
  const std::string whole = read_file(file), valid = read_file(log);
  int64_t last = 0;
  for (size_t at = 0; at < valid.size(); at += 997) {
    write_file(file, whole);
    fs::remove(file.string() + "-shm");
    std::string corrupt = valid;
    corrupt[at] ^= 0x10;
    write_file(log, corrupt);
    const int64_t n = reader_of(file)->size();
    EXPECT_GE(n, last);
    EXPECT_EQ(n % 3, 0);
    expect_entries(*writer_of(file), last = n);
  }
  EXPECT_GE(last, 18);
}

/// A full disk or a kill interrupts SQLite's checkpoint after the header was written, but before
/// some of the pages it refers to. The log has them.
TEST(SqliteMap, ReadsHalfACheckpoint) {
  const TempDir dir;
  uintmax_t bytes = 0;
  {
    const auto map = writer_of(dir / "map");
    map->add(made_entries(1, 9));
    bytes = fs::file_size(dir / "map");
    fs::copy(dir / "map-wal", dir / "half-wal");
  }
  ASSERT_GT(fs::file_size(dir / "map"), bytes);
  fs::copy(dir / "map", dir / "half");
  fs::resize_file(dir / "half", bytes);
  EXPECT_EQ(check_map(dir / "half"), std::vector<std::string>());
  expect_entries(*writer_of(dir / "half"), 9);
  EXPECT_EQ(fs::file_size(dir / "half"), fs::file_size(dir / "map"));
}

TEST(SqliteMap, IsReadInAFolderThatCannotBeWritten) {
  const TempDir dir;
  fs::create_directory(dir / "media");
  const fs::path file = dir / "media/map";
  writer_of(file)->add(made_entries(1, 9));
  fs::permissions(dir.path(), fs::perms(0755));
  fs::permissions(file, fs::perms(0444));
  fs::permissions(dir / "media", fs::perms(0555));
  const auto as_nobody = [&](const std::function<void()>& work) {
    in_another_process([&] {
      ASSERT_TRUE(::geteuid() != 0 || ::setuid(65534) == 0);
      work();
    });
  };
  as_nobody([&] {
    expect_entries(*reader_of(file), 9);
    EXPECT_EQ(check_map(file), std::vector<std::string>());
    expect_no_writing(file, "map: cannot be written");
  });
  // A copy with its log on read-only media: entries that cannot be read are reported.
  fs::permissions(dir / "media", fs::perms(0755));
  write_file(file.string() + "-wal", "something");
  fs::permissions(dir / "media", fs::perms(0555));
  as_nobody([&] {
    expect_error<Error>([&] { reader_of(file); }, {"map-wal: its entries cannot be read"});
  });
  fs::permissions(dir / "media", fs::perms(0755));
}

TEST(SqliteMap, StaysValidOnAFullDisk) {
  const TempDir dir;
  writer_of(dir / "map")->add(made_entries(1, 10));
  in_another_process([&] {
    ::signal(SIGXFSZ, SIG_IGN);
    const rlimit limit{200'000, RLIM_INFINITY};
    ASSERT_EQ(::setrlimit(RLIMIT_FSIZE, &limit), 0);
    const auto map = writer_of(dir / "map");
    const auto fill = [&] {
      for (int64_t id = 11; id < 10'000; ++id) map->add(made_entries(id, id));
    };
    expect_error<Error>(fill, {"map: cannot be"});
    EXPECT_GE(map->size(), 11);
    expect_entries(*map, map->size());
    const rlimit none{0, RLIM_INFINITY};
    ASSERT_EQ(::setrlimit(RLIMIT_FSIZE, &none), 0);
    expect_error<Error>([] { temporary_map({}); }, {"map in TMPDIR", "cannot be read or written"});
  });
  EXPECT_EQ(check_map(dir / "map"), std::vector<std::string>());
  const auto map = writer_of(dir / "map");
  const int64_t size = map->size();
  EXPECT_GE(size, 11);
  map->add(made_entries(size + 1, size + 5));
  expect_entries(*map, size + 5);

  SqliteDriver temporary("", SQLITE_OPEN_READWRITE | SQLITE_OPEN_CREATE, "temporary");
  temporary.execute("PRAGMA max_page_count = 2");
  temporary.execute("CREATE TABLE t (x)");
  const auto fill = [&] { temporary.execute("INSERT INTO t VALUES (zeroblob(100000))"); };
  EXPECT_EQ(message_of<Error>(fill), "temporary: cannot be written: the disk is full");
}

}  // namespace
}  // namespace revisit
