#include "map_options.h"

#include <exception>

#include "cli/built_in.h"
#include "cli/terminal.h"
#include "revisit/base/error.h"

namespace revisit::cli {

void MapOptions::declare(Options& options) {
  options.group("Map:")
      .option("map", "FILE",
              "map file, created if missing, or postgresql://HOST/DATABASE?map=NAME, shared with "
              "other robots (default: none)",
              &file)
      .common()
      .option("projection-from", "MAP",
              "map whose descriptor projection a new map takes over, so that both can be merged",
              &projection)
      .needs("map")
      .option("drive", "NAME",
              "name of this recording in the map; a number is added to a name in use (default: its "
              "sequence or folder)",
              &drive)
      .common()
      .option("warmup", "N",
              "distinct map entries that the map mean is estimated from (default 128)", &warmup)
      .flag("no-clouds", "no points in the map, 20 kB per entry; loops are then not registered",
            &no_clouds)
      .choice<DescriptorType>(
          "dtype", {{"float32", DescriptorType::kFloat32}, {"float16", DescriptorType::kFloat16}},
          "data type of descriptors in a new map (default float32)", &dtype)
      .check([this] {
        need_built_in_for_map("--map", file);
        need_built_in_for_map("--projection-from", projection);
      });
}

std::unique_ptr<MapStore> MapOptions::open(const RecognizerSource& source) const {
  if (file.empty()) return nullptr;
  const MapFingerprint fingerprint =
      PlaceRecognizer::fingerprint_of(source.extractor, source.options);
  if (!projection.empty()) projection_of(projection, fingerprint);  // before a map is created
  auto map = open_map(file, MapAccess::kWrite, &fingerprint, dtype);
  if (!projection.empty()) copy_projection(*map, projection, warn);
  return map;
}

NewMap::NewMap(const std::filesystem::path& map) : exceptions_(std::uncaught_exceptions()) {
  std::error_code unknown;
  if (!is_server_address(map.string()) && !std::filesystem::exists(map, unknown) && !unknown)
    file_ = map;
}

NewMap::~NewMap() {
  if (file_.empty() || std::uncaught_exceptions() == exceptions_) return;
  try {
    const auto map = open_map(file_, MapAccess::kWrite);  // no other process writes now
    if (map->size() > 0) return;
    for (const char* part : {"", "-wal", "-shm"}) std::filesystem::remove(file_.string() + part);
  } catch (const std::exception&) {  // no map was created, or another process uses it
  }
}

}  // namespace revisit::cli
