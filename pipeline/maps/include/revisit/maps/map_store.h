#pragma once

#include <Eigen/Geometry>
#include <array>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <map>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "revisit/base/error.h"

namespace revisit::pipeline {

/// A place as a map keeps it.
struct StoredPlace {
  int64_t id = 0;     // 1, 2, ... in the order of adding; the map gives it
  std::string drive;  // "" when there is one only
  int64_t frame = 0;
  std::optional<double> time;             // [s]
  std::optional<Eigen::Isometry3d> pose;  // T_world_sensor
  std::vector<float> descriptor;
  std::vector<float> feature;  // what the descriptor is made from; empty once the basis is fixed
  std::string cloud;           // its points (compact_cloud()); "": none. MapStore::cloud() reads it
};

/// What defines a descriptor, name -> value: {"feature", "ring"}, {"weights", "sha256 ..."}, ...
using MapIdentity = std::map<std::string, std::string>;

/// How a map keeps the numbers of descriptors; features are always float32. float16 rounds by at
/// most 2^-11 of a number, or by 2^-25 when that is more, and holds numbers below 65520.
enum class NumberFormat { kFloat32, kFloat16 };

/// Where a reader stands.
struct MapPosition {
  int64_t last = 0;      // the last place there is: `after` of the next read()
  int64_t revision = 0;  // how often descriptors were replaced: when it grows, read again from 0
  int64_t removed = 0;   // how many places were removed: when it grows, removed() names them
};

/// Scans of a drive that one process describes into a map on a server, and no other meanwhile. It
/// ends when add() adds them, when it is destroyed (before its SharedWork), and with its process or
/// connection: what was not added can then be claimed again.
struct Claim {
  std::string drive;
  std::vector<int64_t> frames;              // ascending
  std::map<int64_t, std::string> left_out;  // frame -> why it gets no place; nobody tries it again
  virtual ~Claim() = default;
  /// As MapStore::add(), of places of this claim. Throws ClaimLost, too.
  virtual std::vector<int64_t> add(std::span<const StoredPlace> places, int64_t revision) = 0;
};

/// The connection of a claim was lost before its places were known to be added. Either they were,
/// or others can claim them.
class ClaimLost : public Error {
  using Error::Error;
};

/// The places of one map. One thread at a time; other threads and processes open the map again.
///
/// What changes the map is on the disk when the call returns, and is all done or not at all. It
/// throws UsageError for what cannot be stored and in a map opened for reading, Error when the disk
/// is full or another process holds the map, InputError where the map is damaged.
class MapStore {
 public:
  using Take = std::function<void(StoredPlace&&)>;
  using Damaged = std::function<void(const std::string&)>;

  virtual ~MapStore() = default;
  virtual const MapIdentity& identity() const = 0;
  virtual NumberFormat number_format() const = 0;
  /// How many places there are: those that were added, less those that were removed.
  virtual int64_t size() const = 0;

  /// Bytes kept beside the places: the basis, a threshold. Throws InputError when they are damaged.
  virtual std::optional<std::string> value(const std::string& name) const = 0;
  virtual void set_value(const std::string& name, const std::string& bytes) = 0;

  /// Adds places, whatever their `id`, and returns the ids they have now. All numbers are finite.
  /// `revision`: what they were described for; when the map has another, nothing is added and no
  /// ids are returned.
  virtual std::vector<int64_t> add(std::span<const StoredPlace> places,
                                   std::optional<int64_t> revision = std::nullopt) = 0;

  /// Hands over the places with ids above `after`, ascending, as they are at one moment, without
  /// their clouds. Damaged
  /// ones are left out; `damaged` gets a message that names each, and one when places are lost. The
  /// callbacks must not call this object.
  virtual MapPosition read(int64_t after, const Take& take, const Damaged& damaged) const = 0;

  /// The points of a place; "" when the map has none. Throws InputError when they are damaged.
  virtual std::string cloud(int64_t id) const = 0;

  /// Removes places for good, in one step. Their ids are not given again. Damaged places can be
  /// removed, too. Returns how many there were to remove: those removed before do not count. Throws
  /// UsageError for an id that no place has had.
  virtual int64_t remove(std::span<const int64_t> ids) = 0;
  /// The ids of the places that were removed, in the order of their removal, but for the first
  /// `after`.
  virtual std::vector<int64_t> removed(int64_t after = 0) const = 0;

  /// Keeps the name of a drive for the recording of this content, a text that tells it from others.
  /// False when it is kept for another one. A file, which has one writer, keeps none.
  virtual bool reserve_drive(const std::string& /*drive*/, const std::string& /*content*/) {
    return true;
  }

  /// Whether others may have changed the map since the last read(). A file says nothing of others.
  virtual bool has_news() { return false; }

  /// Reads all, and tells `wrong` what is wrong. Throws InputError for damage that ends this.
  virtual void check(const Damaged& wrong) const = 0;

  /// Gives every place the descriptor that `descriptor_of` makes of it, drops the features and sets
  /// `values`, in one step. Damaged places stay so. `descriptor_of` must not call this object.
  /// When the map's revision is not `revision` any more nothing is done, and false returned.
  virtual bool replace_descriptors(
      const std::function<std::vector<float>(const StoredPlace&)>& descriptor_of,
      const std::map<std::string, std::string>& values, int64_t revision) = 0;
};

/// The work that several processes share on a map on a server: scans of drives, each of which one
/// of them describes. One thread at a time. Throws what MapStore throws, and UsageError while a
/// claim of this object is alive.
class SharedWork {
 public:
  virtual ~SharedWork() = default;
  /// The map is to have a place of each of these frames of a drive. Frames that have one, that were
  /// left out or are expected already stay as they are.
  virtual void expect(const std::string& drive, std::span<const int64_t> frames) = 0;
  /// Up to `most` (at least 1) of the expected frames that nobody has claimed; null when there are
  /// none now.
  virtual std::unique_ptr<Claim> claim(const std::string& drive, int64_t most) = 0;
  /// Frames of the drive still expected, claimed or not.
  virtual int64_t expected(const std::string& drive) = 0;
};

/// The names of the values that hold what the descriptors of a map were made with, how its scores
/// become probabilities (calibration_content()), and the score from which a place is accepted. The
/// last two may be empty, which says nothing.
inline constexpr const char* kBasisValue = "basis";
inline constexpr const char* kCalibrationValue = "calibration";
inline constexpr const char* kVerifiedCalibrationValue = "verified calibration";
inline constexpr const char* kThresholdValue = "threshold";
/// A map can do without these: a recognizer skips a corrupt one with a warning.
inline constexpr std::array<std::string_view, 3> kAcceptanceValues = {
    kCalibrationValue, kVerifiedCalibrationValue, kThresholdValue};

/// Whether this is the address of a PostgreSQL server rather than a file.
bool is_on_a_server(std::string_view where);

/// What messages call a map: without the password of a server's address.
std::string shown_name(const std::filesystem::path& map);

enum class MapAccess { kRead, kWrite, kNew };

/// Opens a map. With kWrite and an `identity` it is made when there is none, with `format`, which
/// says nothing about a map that is there; with kNew there must be none. One process writes, any
/// number read meanwhile.
///
/// postgresql://USER@HOST/DATABASE?map=NAME is a map on a server (docs/SERVER.md): there any number
/// of processes write, too. A connection that is lost is made again, for 10 s or patience=SECONDS.
///
/// Throws InputError for a file that is missing, there although it is to be new, not a map, damaged
/// at its head or of a later version, and when `identity` is not the map's: the message has every
/// entry that differs. Throws Error when the file cannot be opened or written, when another process
/// is writing to it, and when a server does not answer or refuses; UsageError for an invalid
/// address, and for a server in a build without libpqxx.
std::unique_ptr<MapStore> open_map(const std::filesystem::path& file, MapAccess access,
                                   const MapIdentity* identity = nullptr,
                                   NumberFormat format = NumberFormat::kFloat32);

/// The work on a map that is on a server; null for a file, which one process writes. Throws as
/// open_map().
std::unique_ptr<SharedWork> open_shared_work(const std::filesystem::path& map);

/// What a map learnt from its first stretch. Throws InputError when it has learnt nothing yet or is
/// of another identity.
std::string basis_of(const std::filesystem::path& map, const MapIdentity& identity);

/// Gives a map without places what another of the same identity learnt from its first stretch: its
/// basis. `damaged` is told what of the map was lost, as by read(). Throws InputError when the
/// other has no basis yet or is of another identity, or when the map has places that were described
/// otherwise.
void take_over_basis(MapStore& map, const std::filesystem::path& other,
                     const MapStore::Damaged& damaged);

/// Puts the places of all `maps` into a new map, `file`, one map after the other, and returns how
/// many there are. All must be of one identity and basis. A scan that several maps have comes once;
/// recordings of one name become MAP/DRIVE in all but the first; a calibration and a threshold are
/// kept when all maps have the same. `report` is told each of these, and each damaged place, which
/// is left out. Throws UsageError without maps and for a map given twice, InputError for what does
/// not fit and a map that is there.
int64_t merge_maps(std::span<const std::filesystem::path> maps, const std::filesystem::path& file,
                   const MapStore::Damaged& report);

/// What made the features of a map, FeatureExtractor::key; "" without a map that can be read.
std::string maker_of(const std::filesystem::path& map);

/// What is wrong with a map, a message each: none when it is sound. Reads all of it. Throws
/// InputError for a file that is missing and Error when it cannot be opened.
std::vector<std::string> check_map(const std::filesystem::path& file);

}  // namespace revisit::pipeline
