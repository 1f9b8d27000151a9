// The log beside a map, looked at while a writer writes it.
#include <fcntl.h>
#include <gtest/gtest.h>
#include <sys/stat.h>
#include <unistd.h>

#include <thread>

#include "journal.h"
#include "revisit/maps/map_store.h"
#include "test_data.h"

namespace revisit::pipeline {
namespace {

namespace fs = std::filesystem;
using test::TempDir;

/// Of a map with five places, each a step. The log is gone when its writer ends.
std::string a_log() {
  const TempDir dir;
  const MapIdentity identity{{"feature", "ring"}};
  const auto map = open_map(dir / "map", MapAccess::kWrite, &identity);
  for (int i = 0; i < 5; ++i) map->add(std::vector<StoredPlace>{{.descriptor = {1, 2}}});
  return test::read_file(dir / "map-wal");
}

/// What is said of a log that has these contents, one after the other, each time it is opened.
std::optional<JournalDamage> damage_of(const std::vector<std::string>& contents) {
  const TempDir dir;
  const fs::path log = dir / "log";
  ::mkfifo(log.c_str(), 0600);
  std::thread writer([&] {
    for (size_t look = 0; look + 1 < contents.size(); ++look) {
      const int pipe = ::open(log.c_str(), O_WRONLY);  // waits until it is looked at
      fs::remove(log);
      if (look + 2 < contents.size())
        ::mkfifo(log.c_str(), 0600);
      else
        test::write_file(log, contents.back());
      const std::string& bytes = contents[look];
      EXPECT_EQ(::write(pipe, bytes.data(), bytes.size()), static_cast<ssize_t>(bytes.size()));
      ::close(pipe);
    }
  });
  const std::optional<JournalDamage> damage = journal_damage(log);
  writer.join();
  return damage;
}

TEST(MapJournal, WhatIsBeingWrittenIsNoDamage) {
  const std::string sound = a_log();
  const auto damaged = [&](int64_t at) {
    std::string log = sound;
    ++log[static_cast<size_t>(at) + 100];
    return log;
  };
  const int64_t frame = 24 + 4096, second = 32 + frame, third = second + frame;
  EXPECT_FALSE(damage_of({damaged(second), sound}));
  EXPECT_FALSE(damage_of({damaged(second), damaged(third), sound}));
  const auto stays = damage_of({damaged(second), damaged(second), sound});
  ASSERT_TRUE(stays);
  EXPECT_EQ(stays->at, second);
}

}  // namespace
}  // namespace revisit::pipeline
