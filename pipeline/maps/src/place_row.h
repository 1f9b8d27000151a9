#pragma once

#include <set>
#include <string>

#include "revisit/maps/map_store.h"
#include "sqlite.h"

namespace revisit {

/// Little-endian, the machine's own byte order.
struct PlaceRow {
  std::string pose;        // "", or 12 float64 [3][4]
  std::string descriptor;  // float32 or float16
  std::string feature;     // float32
};

/// `number`: index in the call, from 1. Throws UsageError for values that cannot be stored.
PlaceRow place_row(const StoredPlace& place, DescriptorType format, size_t number);

/// Throws UsageError for a name with a zero byte, at which a server would truncate it.
void check_drive(const std::string& drive, const std::string& of = "");

void check_places_of(const Claim& claim, std::span<const StoredPlace> places);

std::set<int64_t> ids_to_remove(std::span<const int64_t> ids, int64_t places);

/// Throws UsageError for values that are not finite or too large for the format.
std::string descriptor_bytes(const std::vector<float>& descriptor, DescriptorType format,
                             const std::string& of);

/// Columns except the id, without ownership.
struct RowView {
  std::string_view drive;
  int64_t frame = 0;
  std::optional<double> time;
  std::string_view pose, descriptor, feature;
  int64_t revision = 0, checksum = 0;
};
/// The checksum is not set; see checksum_of().
RowView view_of(const StoredPlace& place, const PlaceRow& row, int64_t revision);
int64_t checksum_of(int64_t id, const RowView& row);
/// Returns "", or the problem of the row.
std::string take_row(int64_t id, const RowView& row, DescriptorType format, int64_t revision,
                     StoredPlace& place);

void insert_place(sqlite::Statement& insert, int64_t id, const StoredPlace& place,
                  const PlaceRow& row, int64_t revision);
inline constexpr const char* kInsertPlace =
    "INSERT INTO place (drive, frame, time, pose, descriptor, feature, revision, checksum, id) "
    "VALUES (?, ?, ?, ?, ?, ?, ?, ?, ?)";
inline constexpr const char* kReplacePlace =
    "UPDATE place SET drive = ?, frame = ?, time = ?, pose = ?, descriptor = ?, feature = ?, "
    "revision = ?, checksum = ? WHERE id = ?";

/// Reads the current row of kSelectPlaces; returns "", or the problem of the row.
std::string take_row(sqlite::Statement& select, DescriptorType format, int64_t revision,
                     StoredPlace& place);
inline constexpr const char* kSelectPlaces =
    "SELECT id, drive, frame, time, pose, descriptor, feature, revision, checksum FROM place "
    "WHERE id > ? AND id <= ? ORDER BY id";

}  // namespace revisit
