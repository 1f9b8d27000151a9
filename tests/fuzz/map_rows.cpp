// Untrusted rows of a map with valid checksums. Random changes of bytes (map.cpp) are mostly
// rejected by SQLite or by a checksum.
#include <unistd.h>

#include <array>
#include <cmath>

#include "bytes.h"
#include "fuzz.h"
#include "map_file.h"
#include "map_format.h"
#include "revisit/loops/loop_detector.h"
#include "small_rings.h"
#include "sqlite_driver.h"

namespace revisit::fuzz {
namespace {

namespace fs = std::filesystem;

const MapOptions kOptions{.warmup = 4};
struct Known {
  FeatureExtractor rings = small_rings();
  MapFingerprint fingerprint = fingerprint_of(rings, kOptions);
  std::string projection = ring_model_content(small_ring_model());
  int64_t dimensions = rings.open_projection(projection).dim;
  std::string calibration = calibration_content({.blocks = {{0.1, 50, 0}, {0.6, 900, 899}}});
};
const Known& known() {
  static const Known known;
  return known;
}

std::string repeated(Bytes& bytes, size_t size) {
  const std::string few = bytes.text(bytes.up_to(24));
  std::string all;
  while (!few.empty() && all.size() < size) all += few;
  all.resize(size);
  return all;
}

std::string blob(Bytes& bytes, size_t usual) {
  const size_t kind = bytes.up_to(7);
  return kind == 0 ? "" : repeated(bytes, kind == 1 ? bytes.number<uint16_t>() : usual);
}

void add_entry(SqlDriver& map, Bytes& bytes, int64_t id, const MapHeader& header) {
  MapEntry entry{.drive = bytes.text(bytes.up_to(3)), .frame = bytes.number<int64_t>()};
  if (bytes.up_to(1) == 1) entry.time = bytes.number<double>();
  const auto numbers =
      static_cast<size_t>(bytes.up_to(1) == 1 ? known().rings.dim : known().dimensions);
  EntryBytes row;
  row.pose = blob(bytes, 96);
  row.descriptor = blob(bytes, 4 * numbers);
  row.feature = blob(bytes, 128);
  const std::vector<SqlValue> columns = entry_columns(id, entry, row, header.revision);
  insert_entries(map, {&columns, 1});
}

void add_value(SqlDriver& map, Bytes& bytes, int64_t id) {
  constexpr std::array kNames{kProjectionValue, kCalibrationValue, kVerifiedCalibrationValue};
  const std::string name = kNames[bytes.up_to(kNames.size() - 1)];
  std::string value = name == kProjectionValue ? known().projection : known().calibration;
  for (size_t changes = bytes.up_to(3); changes > 0; --changes)
    value[bytes.number<uint16_t>() % value.size()] = bytes.number<char>();
  if (bytes.up_to(3) == 0) value = blob(bytes, 8);
  map.execute("INSERT INTO value (id, name, bytes, checksum) VALUES ($1, $2, $3, $4)",
              {id, name, Blob{value}, Checksum().number(id).bytes(name).bytes(value).value()});
}

void change_column(SqlDriver& map, Bytes& bytes) {
  constexpr std::array kColumns{
      "entry SET id",          "entry SET drive",      "entry SET frame",     "entry SET time",
      "entry SET pose",        "entry SET descriptor", "entry SET feature",   "entry SET revision",
      "entry SET checksum",    "value SET id",         "value SET name",      "value SET bytes",
      "value SET checksum",    "map SET id",           "map SET fingerprint", "map SET dtype",
      "map SET revision",      "map SET checksum",     "counts SET id",       "counts SET entries",
      "counts SET \"values\"", "counts SET checksum",  "removed SET id",      "removed SET entry",
      "removed SET checksum"};
  const std::string column = kColumns[bytes.up_to(kColumns.size() - 1)];
  const int64_t row = bytes.number<uint8_t>();
  const size_t type = bytes.up_to(4);
  const std::string text = bytes.text(bytes.up_to(40));
  SqlValue value = nullptr;
  if (type == 1) value = bytes.number<int64_t>();
  if (type == 2) value = bytes.number<double>();
  if (type == 3) value = std::string_view(text);
  if (type == 4) value = Blob{text};
  map.execute("UPDATE OR REPLACE " + column + " = $1 WHERE id = $2", {value, row});
}

void write_map(const fs::path& file, Bytes& bytes) {
  MapHeader header{known().fingerprint};
  MapFile(file).make(header);
  SqliteDriver map(file, SQLITE_OPEN_READWRITE, "<case>");
  map.execute("PRAGMA synchronous = OFF");
  map.transaction(Locking::kWrites, [&] {
    Counts counts;
    while (!bytes.empty()) {
      const size_t kind = bytes.up_to(11);
      const int64_t id = bytes.number<int8_t>();
      if (kind < 6) add_entry(map, bytes, ++counts.entries, header);
      if (kind == 6 || kind == 7) add_value(map, bytes, ++counts.values);
      if (kind == 8) write_removed(map, id);
      if (kind == 9) counts.entries += id;
      if (kind == 10) {
        header.format = id % 2 == 0 ? DescriptorType::kFloat32 : DescriptorType::kFloat16;
        header.revision = bytes.number<int64_t>();
        write_header(map, header);
      }
      write_counts(map, counts);
      if (kind == 11) works_or_refuses([&] { change_column(map, bytes); });
    }
  });
}

/// No content of a map may be reported as an error of the caller.
template <class Work>
void reads_or_refuses(const Work& work) {
  works_or_refuses([&] {
    try {
      work();
    } catch (const UsageError& error) {
      std::fprintf(stderr, "%s\n", error.what());
      require(false, "no UsageError for an untrusted map");
    }
  });
}

void use(const fs::path& file) {
  const auto pass_over = [](const std::string&) {};
  reads_or_refuses([&] { check_map(file); });
  reads_or_refuses([&] {
    const fs::path merged = file.string() + "_merged", copy = file.string() + "_copy";
    fs::copy_file(file, copy);
    const std::array<fs::path, 2> maps{file, copy};
    merge_maps(maps, merged, pass_over);
  });
  reads_or_refuses([&] {
    Map map(known().rings, kOptions, open_map(file, MapAccess::kWrite), pass_over);
    Description scan;
    for (int i = 0; i < 32; ++i) scan.feature.push_back(static_cast<float>(i % 5));
    const auto loop = map.query(scan);
    require(!loop || std::isfinite(loop->score), "a score is a number");
    map.add({{.feature = scan.feature}});
    map.query(scan);
    map.remove(std::array<int64_t, 1>{0});
    LoopDetector detector(map, {.verify = false, .warn = pass_over});
    detector.calibrate({.score = detector.score(), .blocks = {{0.1, 50, 0}, {0.6, 900, 899}}});
    map.refresh();
  });
}

}  // namespace
}  // namespace revisit::fuzz

extern "C" int LLVMFuzzerTestOneInput(const uint8_t* data, size_t size) {
  using namespace revisit;
  namespace fs = std::filesystem;
  const std::string file =
      fs::temp_directory_path() / ("revisit_fuzz_rows_" + std::to_string(::getpid()));
  const auto clear = [&] {
    for (const char* name : {"", "_merged", "_copy"})
      for (const char* ending : {"", "-wal", "-shm", "-journal", "-writer"})
        fs::remove(file + name + ending);
  };
  clear();
  fuzz::known();  // outside of works_or_refuses(): an error here is a bug
  fuzz::Bytes bytes(data, size);
  fuzz::works_or_refuses([&] {
    fuzz::write_map(file, bytes);
    fuzz::use(file);
  });
  clear();
  return 0;
}
