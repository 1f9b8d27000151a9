#include <unistd.h>

#include <array>
#include <fstream>

#include "fuzz.h"
#include "revisit/maps/map_store.h"

extern "C" int LLVMFuzzerTestOneInput(const uint8_t* data, size_t size) {
  using namespace revisit;
  namespace fs = std::filesystem;
  // Not in memory, because SQLite derives the names of other files from this one.
  const fs::path file =
      fs::temp_directory_path() / ("revisit_fuzz_map_" + std::to_string(::getpid()));
  for (const char* ending : {"-wal", "-shm", "-journal"}) fs::remove(file.string() + ending);
  std::ofstream(file, std::ios::binary) << fuzz::text(data, size);
  fuzz::works_or_refuses([&] {
    const auto map = open_map(file, MapAccess::kRead);
    int64_t last = 0;
    map->read(
        0,
        [&](MapEntry&& entry) {
          fuzz::require(entry.id > last, "ids ascend");
          last = entry.id;
        },
        [](const std::string&) {});
    map->value("threshold");
    map->removed();
  });
  fuzz::works_or_refuses([&] { check_map(file); });
  fuzz::works_or_refuses([&] {
    const auto map = open_map(file, MapAccess::kWrite);
    MapEntry entry;
    entry.descriptor = {1, 2};
    map->add({&entry, 1});
    map->set_value("threshold", "1");
    const int64_t revision = map->read(
                                    0, [](MapEntry&&) {}, [](const std::string&) {})
                                 .revision;
    map->replace_descriptors([](const MapEntry& found) { return found.descriptor; }, {}, revision);
    map->remove(std::array<int64_t, 1>{1});
  });
  for (const char* ending : {"", "-wal", "-shm", "-journal"}) fs::remove(file.string() + ending);
  return 0;
}
