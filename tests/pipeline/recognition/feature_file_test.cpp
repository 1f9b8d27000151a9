#include "revisit/recognition/feature_file.h"

#include <sys/resource.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <unistd.h>

#include "revisit/proto/npy.h"
#include "testing.h"

namespace revisit {
namespace {

std::vector<float> row_of(int64_t i, int64_t d) {
  std::vector<float> row(d);
  for (int64_t j = 0; j < d; ++j) row[j] = static_cast<float>(i * 1000 + j) / 3;
  return row;
}

void write_all(const fs::path& file, const std::string& key, int64_t n, int64_t d) {
  FeatureWriter writer(file, key, n, d);
  for (int64_t i = writer.rows_written(); i < n; ++i) writer.append(row_of(i, d));
  writer.finish();
}

TEST(FeatureFile, RoundTrip) {
  const TempDir dir;
  const fs::path file = dir / "deeper/features";
  write_all(file, "a key", 5, 7);
  EXPECT_TRUE(features_complete(file, "a key"));
  EXPECT_FALSE(features_complete(file, "another key"));
  EXPECT_FALSE(fs::exists(file.string() + ".part"));

  const FeatureFile features(file);
  EXPECT_EQ(features.n(), 5);
  EXPECT_EQ(features.d(), 7);
  for (int64_t i = 0; i < 5; ++i)
    EXPECT_EQ(std::vector<float>(features.row(i).begin(), features.row(i).end()), row_of(i, 7));
  float some[3];
  features.read(4, 2, 3, some);
  EXPECT_EQ(some[2], row_of(4, 7)[4]);
}

TEST(FeatureFile, ARowHasFloatsBesideItsFeature) {
  const TempDir dir;
  FeatureWriter writer(dir / "f.features", "key", 4, 7, 2);
  EXPECT_THROW(writer.append(row_of(0, 7)), Error);
  for (int64_t i = 0; i < 4; ++i) writer.append(row_of(i, 7), row_of(i + 10, 2));
  writer.finish();
  EXPECT_TRUE(features_complete(dir / "f.features", "key"));
  const FeatureFile features(dir / "f.features");
  EXPECT_EQ(features.d(), 7);
  EXPECT_EQ(features.rows().row(3)[6], row_of(3, 7)[6]);
  ASSERT_EQ(features.extra(3).size(), 2U);
  EXPECT_EQ(features.extra(3)[1], row_of(13, 2)[1]);
  float last = 0;
  features.read(3, 6, 1, &last);
  EXPECT_EQ(last, row_of(3, 7)[6]);
}

TEST(FeatureFile, GoesOnWhereItStoppedAndCutsATornRow) {
  const TempDir dir;
  write_all(dir / "whole.features", "key", 6, 9);
  {
    FeatureWriter writer(dir / "f.features", "key", 6, 9);
    for (int64_t i = 0; i < 3; ++i) writer.append(row_of(i, 9));
  }
  std::ofstream(dir / "f.features.part", std::ios::app | std::ios::binary) << "torn row";
  EXPECT_FALSE(fs::exists(dir / "f.features"));
  EXPECT_FALSE(features_complete(dir / "f.features", "key"));
  EXPECT_EQ(FeatureWriter(dir / "f.features", "key", 6, 9).rows_written(), 3);
  write_all(dir / "f.features", "key", 6, 9);
  EXPECT_EQ(read_file(dir / "f.features"), read_file(dir / "whole.features"));
}

TEST(FeatureFile, AnotherKeyOrShapeStartsAnew) {
  const TempDir dir;
  const auto begin = [&](const char* key, int64_t n, int64_t d) {
    FeatureWriter writer(dir / "f.features", key, n, d);
    const int64_t found = writer.rows_written();
    if (found == 0) writer.append(row_of(1, d));
    return found;
  };
  EXPECT_EQ(begin("one", 6, 9), 0);
  EXPECT_EQ(begin("one", 6, 9), 1);
  EXPECT_EQ(begin("two", 6, 9), 0);
  EXPECT_EQ(begin("two", 7, 9), 0);
  EXPECT_EQ(begin("two", 7, 8), 0);
  EXPECT_EQ(begin("two", 7, 8), 1);
}

TEST(FeatureFile, FinishedFileOfAnotherKeyIsReplacedOnlyAtTheEnd) {
  const TempDir dir;
  write_all(dir / "f.features", "old", 2, 3);
  {
    FeatureWriter writer(dir / "f.features", "new", 4, 3);
    writer.append(row_of(0, 3));
    EXPECT_TRUE(features_complete(dir / "f.features", "old"));
    EXPECT_THROW(writer.finish(), Error);  // three rows are missing
  }
  write_all(dir / "f.features", "new", 4, 3);
  EXPECT_TRUE(features_complete(dir / "f.features", "new"));
  EXPECT_EQ(FeatureFile(dir / "f.features").n(), 4);
}

TEST(FeatureFile, KilledMidwayThenResumedGivesTheSameBytes) {
  const TempDir dir;
  constexpr int64_t kRows = 400, kDim = 5000;
  write_all(dir / "whole.features", "key", kRows, kDim);
  const pid_t child = ::fork();
  if (child == 0) {
    FeatureWriter writer(dir / "f.features", "key", kRows, kDim);
    for (int64_t i = 0; i < kRows; ++i) {
      writer.append(row_of(i, kDim));
      if (i == 150) ::kill(::getpid(), SIGKILL);
    }
    ::_exit(0);
  }
  int status = 0;
  ASSERT_EQ(::waitpid(child, &status, 0), child);
  ASSERT_TRUE(WIFSIGNALED(status));
  EXPECT_FALSE(fs::exists(dir / "f.features"));
  EXPECT_EQ(FeatureWriter(dir / "f.features", "key", kRows, kDim).rows_written(), 151);
  write_all(dir / "f.features", "key", kRows, kDim);
  EXPECT_EQ(read_file(dir / "f.features"), read_file(dir / "whole.features"));
}

/// Limits the size of files, in a child process, so that write() fails in the middle of a row.
TEST(FeatureFile, FullDiskNamesTheNeededSpaceAndKeepsTheRows) {
  const TempDir dir;
  constexpr int64_t kDim = 1000;
  const pid_t child = ::fork();
  if (child == 0) {
    ::signal(SIGXFSZ, SIG_IGN);  // write() returns EFBIG instead
    const rlimit limit{10'500, 10'500};
    ::setrlimit(RLIMIT_FSIZE, &limit);
    std::string message;
    try {
      write_all(dir / "f.features", "key", 10, kDim);
    } catch (const Error& error) {
      message = error.what();
    }
    std::ofstream(dir / "message") << message;
    ::_exit(0);
  }
  int status = 0;
  ASSERT_EQ(::waitpid(child, &status, 0), child);
  const std::string message = read_file(dir / "message");
  EXPECT_HAS(message, "f.features.part");
  EXPECT_HAS(message, "2 of 10");
  EXPECT_HAS(message, "32000 bytes");
  EXPECT_FALSE(fs::exists(dir / "f.features"));
  write_all(dir / "whole.features", "key", 10, kDim);
  write_all(dir / "f.features", "key", 10, kDim);
  EXPECT_EQ(read_file(dir / "f.features"), read_file(dir / "whole.features"));
}

TEST(FeatureFile, TooLittleSpaceIsSaidBeforeTheFirstRow) {
  const TempDir dir;
  expect_error<Error>(  // are 4 PiB free?
      [&] { FeatureWriter(dir / "f.features", "key", int64_t{1} << 30, int64_t{1} << 20); },
      {"4503599627370496 bytes"});
  EXPECT_THROW(FeatureWriter(dir / "f.features", "key", int64_t{1} << 40, int64_t{1} << 40), Error);
  EXPECT_THROW(FeatureWriter(dir / "f.features", "key", 1, 0), Error);
  EXPECT_THROW(FeatureWriter("/proc/no/f.features", "key", 1, 1), Error);
}

TEST(FeatureFile, OneWriterAtATime) {
  const TempDir dir;
  const FeatureWriter first(dir / "f.features", "key", 3, 2);
  EXPECT_THROW(FeatureWriter(dir / "f.features", "key", 3, 2), Error);
}

TEST(FeatureFile, ChangedFilesAreNotComplete) {
  const TempDir dir;
  const fs::path file = dir / "f.features";
  write_all(file, "key", 20, 50);
  const std::string good = read_file(file);
  const auto expect_made_anew = [&](const char* what) {
    SCOPED_TRACE(what);
    EXPECT_FALSE(features_complete(file, "key"));
    write_all(file, "key", 20, 50);
    EXPECT_TRUE(features_complete(file, "key"));
    EXPECT_EQ(read_file(file), good);
  };
  write_file(file, good.substr(0, good.size() - 3));
  expect_made_anew("cut off");
  write_file(file, "");
  expect_made_anew("empty");
  write_file(file, "garbage");
  expect_made_anew("garbage");
  const size_t key = good.find("key");
  for (const size_t at : {size_t{0}, size_t{32}, size_t{40}, size_t{56}, key, size_t{128},
                          good.size() / 2, good.size() - 9, good.size() - 1}) {
    std::string flipped = good;
    flipped[at] = static_cast<char>(flipped[at] ^ 0x40);
    write_file(file, flipped);
    expect_made_anew("a flipped bit");
  }
  std::string nans = good;
  for (size_t i = good.size() - 408; i < good.size() - 8; i += 4)
    nans.replace(i, 4, "\0\0\xc0\x7f", 4);
  write_file(file, nans);
  expect_made_anew("NaN");
  write_file(file, proto::npy_header({20, 5}) + std::string(400, 'x'));
  expect_made_anew("an array without a key");
  fs::remove(file);
  write_all(file, "kez", 20, 50);
  expect_made_anew("another key");
}

TEST(FeatureFile, AKillBeforeTheRenameLosesNothing) {
  const TempDir dir;
  write_all(dir / "f.features", "key", 20, 50);
  fs::rename(dir / "f.features", dir / "f.features.part");
  EXPECT_FALSE(features_complete(dir / "f.features", "key"));
  FeatureWriter writer(dir / "f.features", "key", 20, 50);
  EXPECT_EQ(writer.rows_written(), 20);
  writer.finish();
  EXPECT_TRUE(features_complete(dir / "f.features", "key"));
}

TEST(FeatureFile, ALinkOrAPipeInThePlaceOfThePartIsRefused) {
  const TempDir dir;
  write_file(dir / "victim", "precious");
  fs::create_symlink(dir / "victim", dir / "f.features.part");
  EXPECT_THROW(write_all(dir / "f.features", "key", 3, 2), Error);
  EXPECT_EQ(read_file(dir / "victim"), "precious");
  ASSERT_EQ(::mkfifo((dir / "g.features.part").c_str(), 0600), 0);
  EXPECT_THROW(write_all(dir / "g.features", "key", 3, 2), Error);
}

TEST(FeatureFile, RowsMustFit) {
  const TempDir dir;
  FeatureWriter writer(dir / "f.features", "key", 1, 2);
  EXPECT_THROW(writer.append(std::vector<float>(3)), Error);
  writer.append(std::vector<float>(2));
  EXPECT_THROW(writer.append(std::vector<float>(2)), Error);
}

TEST(FeatureFile, RejectsOtherFiles) {
  const TempDir dir;
  const auto refused = [&](const std::string& content) {
    write_file(dir / "bad.npy", content);
    EXPECT_THROW(FeatureFile(dir / "bad.npy"), InputError) << content.substr(0, 90);
  };
  EXPECT_THROW(FeatureFile(dir / "absent.npy"), InputError);
  EXPECT_THROW(FeatureFile(dir.path()), InputError);
  const std::string header = proto::npy_header({2, 3});
  const std::string good = header + std::string(24, 'x');
  write_file(dir / "good.npy", good);
  EXPECT_EQ(FeatureFile(dir / "good.npy").n(), 2);
  for (size_t length = 0; length < good.size(); ++length) refused(good.substr(0, length));
  refused(good + "x");
  const auto changed = [&](const std::string& from, const std::string& to) {
    std::string other = good;
    const size_t at = other.find(from);
    ASSERT_NE(at, std::string::npos) << from;
    refused(other.replace(at, from.size(), to));
  };
  changed("<f4", "<f8");
  changed("False", "True ");
  changed("(2, 3)", "(2, 4)");
  changed("(2, 3)", "(6,  )");
  changed("NUMPY", "NUMPI");
  refused(proto::npy_header({6}) + std::string(24, 'x'));
  refused(proto::npy_header({1, 2, 3}) + std::string(24, 'x'));
  refused(proto::npy_header({999'999'999'999'999, 999'999'999'999'999}) + std::string(24, 'x'));
}

TEST(FeatureFile, RejectsCorruptHeaders) {
  const TempDir dir;
  write_all(dir / "f.features", "key", 3, 2);
  const std::string good = read_file(dir / "f.features");
  for (const size_t field : {32, 40, 48, 56})  // n, d, extra, bytes of the key
    for (const int64_t value : {int64_t{-1}, int64_t{1} << 39, int64_t{1} << 62}) {
      std::string bad = good;
      bad.replace(field, 8, reinterpret_cast<const char*>(&value), 8);
      write_file(dir / "bad", bad);
      EXPECT_THROW(FeatureFile(dir / "bad"), InputError) << field << ": " << value;
    }
  for (size_t length = 0; length < good.size(); ++length) {
    write_file(dir / "bad", good.substr(0, length));
    EXPECT_THROW(FeatureFile(dir / "bad"), InputError) << length;
  }
}

TEST(FeatureFile, APipeIsRefusedAndNotWaitedFor) {
  const TempDir dir;
  ASSERT_EQ(::mkfifo((dir / "pipe").c_str(), 0600), 0);
  EXPECT_THROW(FeatureFile(dir / "pipe"), InputError);
}

TEST(FeatureFile, NoticesThatTheFileBecameShorter) {
  const TempDir dir;
  write_all(dir / "f.features", "key", 100, 100);
  const FeatureFile features(dir / "f.features");
  fs::resize_file(dir / "f.features", 1000);
  std::vector<float> row(100);
  EXPECT_THROW(features.read(99, 0, 100, row.data()), InputError);
}

}  // namespace
}  // namespace revisit
