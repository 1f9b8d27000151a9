#include "map_file.h"
#include "map_format.h"
#include "postgres_map.h"
#include "revisit/base/error.h"
#include "revisit/recognition/ring/model.h"

namespace revisit {
namespace {

namespace fs = std::filesystem;

std::unique_ptr<SqlDriver> open_file(const fs::path& path, MapAccess access,
                                     const MapFingerprint* fingerprint, DescriptorType format) {
  if (access == MapAccess::kRead) return MapFile::existing(path).open_for_reading();
  const auto look = [&] {
    MapFile file = fingerprint == nullptr ? MapFile::existing(path) : MapFile(path);
    if (access == MapAccess::kNew && file.exists())
      throw InputError(file.name(), ": already exists");
    if (!file.is_empty()) file.check_is_a_map();
    return file;
  };
  auto lock = look().lock();
  const MapFile file = look();  // another process may have created it meanwhile
  if (file.is_empty()) file.make({.fingerprint = *fingerprint, .format = format});
  return file.open_for_writing(std::move(lock));
}

void check_projection(const MapStore& map) {
  const auto projection = map.value(kProjectionValue);
  MapFingerprint fingerprint = map.fingerprint();
  if (!projection || fingerprint["feature"] != "ring") return;
  const std::string name = map.name() + ": its projection";
  const int64_t dim = parse_ring_model(*projection, name).dim();
  if (str(dim) != fingerprint[kFeatureDimensions])
    throw InputError(name, ": for ", dim, " dimensions, but its features have ",
                     fingerprint[kFeatureDimensions]);
}

void check_calibrations(const MapStore& map, const MapStore::Warn& report) {
  for (const char* name : {kCalibrationValue, kVerifiedCalibrationValue}) try {
      if (const auto content = map.value(name); content && !content->empty())
        parse_calibration(*content, str(map.name(), ": its ", name));
    } catch (const InputError& error) {
      report(error.what());
    }
}

}  // namespace

bool is_server_address(std::string_view where) {
  return where.starts_with("postgresql://") || where.starts_with("postgres://");
}

std::string display_name(const fs::path& map) {
  return is_server_address(map.string()) ? postgres::parse_address(map.string()).name
                                         : map.string();
}

std::unique_ptr<MapStore> open_map(const fs::path& file, MapAccess access,
                                   const MapFingerprint* fingerprint, DescriptorType format) {
  auto map =
      std::make_unique<MapStore>(is_server_address(file.string())
                                     ? open_postgres_map(file.string(), access, fingerprint, format)
                                     : open_file(file, access, fingerprint, format),
                                 access);
  if (fingerprint != nullptr) must_match(display_name(file), map->fingerprint(), *fingerprint);
  return map;
}

std::string feature_key_of(const MapFingerprint& fingerprint) {
  const auto key = fingerprint.find(kFeatureKey);
  return key == fingerprint.end() ? "" : key->second;
}

std::string feature_key_of(const fs::path& map) {
  if (map.empty()) return "";
  try {
    return feature_key_of(open_map(map, MapAccess::kRead)->fingerprint());
  } catch (const InputError&) {
    return "";
  }
}

std::vector<std::string> check_map(const fs::path& file) {
  if (!is_server_address(file.string())) MapFile::existing(file);
  std::vector<std::string> problems;
  const auto report = [&](const std::string& problem) { problems.push_back(problem); };
  try {
    const auto map = open_map(file, MapAccess::kRead);
    map->check(report);
    check_calibrations(*map, report);
    check_projection(*map);
  } catch (const InputError& error) {
    problems.emplace_back(error.what());
  }
  return problems;
}

}  // namespace revisit
