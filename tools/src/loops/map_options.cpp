#include "map_options.h"

#include <exception>

#include "cli/built_in.h"
#include "cli/messages.h"
#include "revisit/base/error.h"

namespace revisit::cli {

using pipeline::NumberFormat;

void MapOptions::declare(Parser& parser) {
  parser.group("Map:")
      .option("map", "FILE",
              "where places are kept; made when missing (default: nowhere). "
              "postgresql://HOST/DATABASE?map=NAME: on a server, with other robots",
              &file)
      .option("basis", "MAP",
              "a new map takes over what that one learnt from its first stretch, so that both can "
              "be merged",
              &basis)
      .option("drive", "NAME",
              "name of this recording in the map (default: its sequence or folder); another "
              "recording of that name gets a number",
              &drive)
      .option("first-stretch", "N",
              "ring: its mean is learnt from so many distinct places (default 128)", &first_stretch)
      .flag("no-clouds", "store no points of places (some 20 kB each): loops are not registered",
            &no_clouds)
      .choice<NumberFormat>(
          "numbers", {{"float32", NumberFormat::kFloat32}, {"float16", NumberFormat::kFloat16}},
          "of a new map (default float32)", &numbers);
}

void MapOptions::check() const {
  need_built_in_for_map("--map", file);
  need_built_in_for_map("--basis", basis);
  if (!basis.empty() && file.empty()) throw UsageError("--basis: add --map, which takes it");
}

std::unique_ptr<pipeline::MapStore> MapOptions::open(const RecognizerSource& source) const {
  if (file.empty()) return nullptr;
  const pipeline::MapIdentity identity =
      pipeline::PlaceRecognizer::identity_of(source.extractor, source.options);
  if (!basis.empty()) pipeline::basis_of(basis, identity);  // before a map is made
  auto map = pipeline::open_map(file, pipeline::MapAccess::kWrite, &identity, numbers);
  if (!basis.empty()) pipeline::take_over_basis(*map, basis, warn);
  return map;
}

NewMap::NewMap(const std::filesystem::path& map) : exceptions_(std::uncaught_exceptions()) {
  std::error_code unknown;
  if (!pipeline::is_on_a_server(map.string()) && !std::filesystem::exists(map, unknown) && !unknown)
    file_ = map;
}

NewMap::~NewMap() {
  if (file_.empty() || std::uncaught_exceptions() == exceptions_) return;
  try {
    const auto map = pipeline::open_map(file_, pipeline::MapAccess::kWrite);  // no other writes now
    if (map->size() > 0) return;
    for (const char* part : {"", "-wal", "-shm"}) std::filesystem::remove(file_.string() + part);
  } catch (const std::exception&) {  // no map was made, or another process has it
  }
}

}  // namespace revisit::cli
