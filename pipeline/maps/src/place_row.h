#pragma once

#include <set>
#include <string>

#include "revisit/maps/map_store.h"
#include "sqlite.h"

namespace revisit::pipeline {

/// The columns of a place in the file. The machine's own byte order, which is little-endian.
struct PlaceRow {
  std::string pose;        // "", or 12 float64 [3][4]
  std::string descriptor;  // float32 or float16
  std::string feature;     // float32
};

/// Throws UsageError, naming place `number` of the call, for what cannot be stored.
PlaceRow place_row(const StoredPlace& place, NumberFormat format, size_t number);

/// Throws UsageError for a name with a zero byte, where a server would cut it.
/// `of` begins the message.
void check_drive(const std::string& drive, const std::string& of = "");

/// Throws UsageError when the claim does not have all of the places.
void check_places_of(const Claim& claim, std::span<const StoredPlace> places);

/// Throws UsageError unless all are ids of the places 1 to `places`.
std::set<int64_t> ids_to_remove(std::span<const int64_t> ids, int64_t places);

/// Throws UsageError.
std::string descriptor_bytes(const std::vector<float>& descriptor, NumberFormat format,
                             const std::string& of);

/// All columns of a place but its id, wherever they are.
struct RowView {
  std::string_view drive;
  int64_t frame = 0;
  std::optional<double> time;
  std::string_view pose, descriptor, feature;
  int64_t revision = 0, checksum = 0;
};
/// Without its checksum, which checksum_of() gives.
RowView view_of(const StoredPlace& place, const PlaceRow& row, int64_t revision);
int64_t checksum_of(int64_t id, const RowView& row);
/// Returns "", or what is wrong with the row.
std::string take_row(int64_t id, const RowView& row, NumberFormat format, int64_t revision,
                     StoredPlace& place);

void insert_place(sqlite::Statement& insert, int64_t id, const StoredPlace& place,
                  const PlaceRow& row, int64_t revision);
inline constexpr const char* kInsertPlace =
    "INSERT INTO place (drive, frame, time, pose, descriptor, feature, revision, checksum, id) "
    "VALUES (?, ?, ?, ?, ?, ?, ?, ?, ?)";
/// With the same parameters, for a place that is there.
inline constexpr const char* kReplacePlace =
    "UPDATE place SET drive = ?, frame = ?, time = ?, pose = ?, descriptor = ?, feature = ?, "
    "revision = ?, checksum = ? WHERE id = ?";

/// Takes the row of `select`, the statement kSelectPlaces; returns "", or what is wrong with it.
std::string take_row(sqlite::Statement& select, NumberFormat format, int64_t revision,
                     StoredPlace& place);
inline constexpr const char* kSelectPlaces =
    "SELECT id, drive, frame, time, pose, descriptor, feature, revision, checksum FROM place "
    "WHERE id > ? AND id <= ? ORDER BY id";

}  // namespace revisit::pipeline
