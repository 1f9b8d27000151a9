#pragma once

#include <Eigen/Geometry>
#include <array>
#include <concepts>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <map>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <type_traits>
#include <vector>

#include "revisit/base/error.h"

namespace revisit {

/// An accepted loop from an entry to an earlier one, with its registration.
struct MapLoop {
  int64_t place = 0;                                                ///< id of the earlier entry
  Eigen::Isometry3d T_place_query = Eigen::Isometry3d::Identity();  ///< from query to place [m]
  /// Registration::information.
  Eigen::Matrix<double, 6, 6> information = Eigen::Matrix<double, 6, 6>::Zero();
};

/// A scan in a map.
struct MapEntry {
  int64_t id = 0;              ///< 1, 2, ... in the order of insertion; assigned by the map
  std::string drive;           ///< recording that it is from
  int64_t frame = 0;           ///< ascends in a drive
  std::optional<double> time;  ///< [s]
  std::optional<Eigen::Isometry3d> pose;  ///< T_world_sensor
  std::vector<float> descriptor;          ///< [dim], what queries are compared with
  /// Source of the descriptor, which is empty during the warm-up; empty after it.
  std::vector<float> feature;
  std::string cloud;                ///< compact_cloud(); "": none. Read by MapStore::cloud()
  std::vector<MapLoop> loops;       ///< to earlier entries, accepted when it was added
  std::vector<int64_t> questioned;  ///< ids of earlier entries whose loops this one contradicts
};

/// Settings that define a map's descriptors, name -> value: {"feature", "ring"}, ...
using MapFingerprint = std::map<std::string, std::string>;

/// Storage format of descriptors; features are bfloat16, within 2^-9. float16 rounds by at most
/// 2^-11 relative or 2^-25 absolute, whichever is larger, and holds magnitudes below 65520.
enum class DescriptorType { kFloat32, kFloat16 };
/// Returns "float32" or "float16".
const char* name_of(DescriptorType type);
/// Empty for another name.
std::optional<DescriptorType> descriptor_type_of(std::string_view name);

/// Position in a map that other processes may change.
struct MapState {
  int64_t last = 0;      ///< id of the last entry; `after` of the next read()
  int64_t revision = 0;  ///< number of descriptor replacements; if it grows, read again from 0
  int64_t removed = 0;   ///< number of removed entries; if it grows, removed() lists them
};

/// The connection was lost, and with it the claim of MapStore::claim(): other processes may
/// describe its scans. Nothing was added.
class ClaimLost : public Error {
  using Error::Error;
};

class SqlDriver;

/// Reads or changes an existing map, or creates one, see open_map().
enum class MapAccess { kRead, kWrite, kNew };

/// Entries of one map (open_map()). Not thread-safe; other threads and processes open the map
/// again.
///
/// Each change is one transaction and durable when the call returns. Changes throw UsageError if
/// the values cannot be stored or the map was opened for reading, Error if the disk is full or
/// another process holds the map, and InputError if the map is corrupt.
class MapStore {
 public:
  using Take = std::function<void(MapEntry&&)>;          ///< gets the entries of read()
  using Warn = std::function<void(const std::string&)>;  ///< gets a message per problem

  MapStore(std::unique_ptr<SqlDriver> driver, MapAccess access);  ///< open_map() calls it
  ~MapStore();

  /// For messages.
  const std::string& name() const;
  const MapFingerprint& fingerprint() const { return fingerprint_; }   ///< of the header
  DescriptorType descriptor_type() const { return descriptor_type_; }  ///< as stored
  /// Number of entries, without the removed ones.
  int64_t size() const;
  /// Dimensions of most stored descriptors; absent during the warm-up.
  std::optional<int64_t> dimensions() const;

  /// Named bytes beside the entries. Throws InputError if they are corrupt.
  std::optional<std::string> value(const std::string& name) const;
  void set_value(const std::string& name, const std::string& bytes);  ///< replaces value()

  /// Ignores `id` and returns the assigned ids. All values must be finite. `revision` is the one
  /// that the entries were described for. If the map has another one, nothing is added and the
  /// result is empty. Throws ClaimLost after claim().
  std::vector<int64_t> add(std::span<const MapEntry> entries,
                           std::optional<int64_t> revision = std::nullopt);

  /// Passes a snapshot of the entries with ids above `after` to `take`, in ascending order, without
  /// their clouds. Corrupt entries are skipped; `warn` gets a message for each, and one if
  /// entries are missing. The callbacks must not call this object.
  MapState read(int64_t after, const Take& take, const Warn& warn) const;

  /// Points of an entry; "" if the map has none. Throws InputError if they are corrupt.
  std::string cloud(int64_t id) const;

  /// Removes entries permanently, in one transaction. Ids are not reused. Corrupt entries can be
  /// removed, too. Returns the number removed now. Throws UsageError for an id that was never
  /// assigned.
  int64_t remove(std::span<const int64_t> ids);
  /// Ids of removed entries in the order of removal, without the first `after`.
  std::vector<int64_t> removed(int64_t after = 0) const;

  /// Reserves a name for the recording that `content` identifies. Returns false if another
  /// recording has it. A file has a single writer and reserves nothing.
  bool reserve_drive(const std::string& drive, const std::string& content);

  /// Claims up to `most` (at least 1) of these scans. Until the next call, or until the connection
  /// to a server ends, no other process can claim them. Others may have added them before:
  /// has_updates() is then true. A file has a single writer, which gets the first ones.
  std::vector<int64_t> claim(const std::string& drive, std::span<const int64_t> frames,
                             int64_t most);

  /// True if other processes may have changed the map since the last read().
  bool has_updates();

  /// Reads the whole map and passes each problem to `report`. Throws InputError if a defect
  /// prevents further reading.
  void check(const Warn& report) const;

  /// Replaces every descriptor by descriptor_of(entry), drops the features and sets `values`, in
  /// one transaction. Corrupt entries are not changed. `descriptor_of` must not call this object.
  /// If the map's revision is not `revision`, nothing changes and the result is false.
  bool replace_descriptors(const std::function<std::vector<float>(const MapEntry&)>& descriptor_of,
                           const std::map<std::string, std::string>& values, int64_t revision);

 private:
  void must_be_writer() const;

  std::unique_ptr<SqlDriver> driver_;
  MapAccess access_;
  MapFingerprint fingerprint_;
  DescriptorType descriptor_type_ = DescriptorType::kFloat32;
  std::optional<int64_t> claimed_on_;  ///< SqlDriver::connections
};

/// Names of MapStore::value(). A map can do without calibrations, which are calibration_content().
inline constexpr const char* kProjectionValue = "projection";    ///< Projection::content
inline constexpr const char* kCalibrationValue = "calibration";  ///< of similarities
inline constexpr const char* kVerifiedCalibrationValue =
    "verified calibration";  ///< of registered loops

bool is_server_address(std::string_view where);  ///< postgresql://... or postgres://...

/// Name of a map for messages: a server's address without its password.
std::string display_name(const std::filesystem::path& map);

/// kWrite with a `fingerprint` creates a missing map with `format`, which is ignored for an
/// existing one; kNew requires that the map does not exist. One process can write while any number
/// read.
///
/// `postgresql://USER@HOST/DATABASE?map=NAME` is a map on a server (docs/MAPS.md), which any number
/// of processes can write. A lost connection is reopened, for up to 10 s or patience=SECONDS.
///
/// Throws InputError if the file is missing, exists (kNew), is no map, has a corrupt header or
/// another version, or if `fingerprint` differs from the map's; the message lists each difference.
/// Throws Error if the file cannot be opened or written, if another process is writing to it, or if
/// a server does not answer or rejects the connection. Throws UsageError for an invalid address,
/// and for a server in a build without libpq.
std::unique_ptr<MapStore> open_map(const std::filesystem::path& file, MapAccess access,
                                   const MapFingerprint* fingerprint = nullptr,
                                   DescriptorType format = DescriptorType::kFloat32);
/// Does not compile, to explain that Map takes the sensor.
template <std::convertible_to<std::string_view> Sensor>
void open_map(const std::filesystem::path&, const Sensor&) {
  static_assert(!std::is_same_v<Sensor, Sensor>,
                "open_map() opens entries; for a LoopDetector write: "
                "revisit::Map map(\"site.map\", {.sensor = \"vlp16\"});");
}

/// Reads the descriptor projection of a map. Throws InputError if its warm-up is not complete or
/// its fingerprint differs.
std::string projection_of(const std::filesystem::path& map, const MapFingerprint& fingerprint);

/// Copies the descriptor projection of another map to a map without entries. `warn` gets a message
/// for each part of the map that was lost, as from read(). Throws InputError if the other map has
/// no projection yet or another fingerprint, or if the map has entries described with another
/// projection.
void copy_projection(MapStore& map, const std::filesystem::path& other, const MapStore::Warn& warn);

/// Merges `maps`, in this order, into a new map `file` and returns the number of entries. A scan in
/// several maps is stored once. Recordings with equal names become MAP/DRIVE in all but the first
/// map. A calibration is kept if all maps have the same. `report` gets a message
/// for each of these events and for each corrupt entry, which is skipped. Throws UsageError without
/// maps or for a map given twice. Throws InputError if fingerprints or descriptor projections
/// differ or `file` exists.
int64_t merge_maps(std::span<const std::filesystem::path> maps, const std::filesystem::path& file,
                   const MapStore::Warn& report);

/// FeatureExtractor::key of the features of a map; "" if the map cannot be read.
std::string feature_key_of(const std::filesystem::path& map);
std::string feature_key_of(const MapFingerprint& fingerprint);  ///< of these settings

/// Reads the whole map and returns a message for each problem. Throws InputError if the file is
/// missing, Error if it cannot be opened.
std::vector<std::string> check_map(const std::filesystem::path& file);

}  // namespace revisit
