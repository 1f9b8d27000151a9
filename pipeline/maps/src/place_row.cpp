#include "place_row.h"

#include <Eigen/Core>
#include <algorithm>
#include <bit>
#include <cmath>
#include <cstring>

#include "checksum.h"
#include "revisit/base/error.h"

namespace revisit {
namespace {

static_assert(std::endian::native == std::endian::little, "maps hold the machine's own bytes");

using PoseNumbers = Eigen::Matrix<double, 3, 4, Eigen::RowMajor>;

template <class Number>
std::string bytes_of_numbers(const Number* numbers, size_t n) {
  std::string bytes(n * sizeof(Number), '\0');
  if (n > 0) std::memcpy(bytes.data(), numbers, bytes.size());
  return bytes;
}

template <class Number>
std::vector<Number> numbers_of(std::string_view bytes) {
  std::vector<Number> numbers(bytes.size() / sizeof(Number));
  if (!numbers.empty()) std::memcpy(numbers.data(), bytes.data(), numbers.size() * sizeof(Number));
  return numbers;
}

bool has_zero_byte(std::string_view drive) {
  return drive.find('\0') != std::string_view::npos;
}

bool all_finite(const std::vector<float>& numbers) {
  return std::ranges::all_of(numbers, [](float number) { return std::isfinite(number); });
}

std::string float32_bytes(const std::vector<float>& numbers, const std::string& of) {
  for (const float number : numbers)
    if (!std::isfinite(number)) throw UsageError(of, " has numbers that are not finite: ", number);
  return bytes_of_numbers(numbers.data(), numbers.size());
}

}  // namespace

std::string descriptor_bytes(const std::vector<float>& descriptor, DescriptorType format,
                             const std::string& of) {
  std::string bytes = float32_bytes(descriptor, of);
  if (format == DescriptorType::kFloat32) return bytes;
  std::vector<Eigen::half> halves(descriptor.size());
  for (size_t i = 0; i < halves.size(); ++i) {
    halves[i] = Eigen::half(descriptor[i]);
    if (!(Eigen::numext::isfinite)(halves[i]))
      throw UsageError(
          str(of, " has ", descriptor[i], ", too large for float16 (at most 65504); keep float32"));
  }
  return bytes_of_numbers(halves.data(), halves.size());
}

void check_drive(const std::string& drive, const std::string& of) {
  if (has_zero_byte(drive))
    throw UsageError(of, "the name of drive '", drive.c_str(),
                     "' has a zero byte after that; remove it");
}

void check_places_of(const Claim& claim, std::span<const StoredPlace> places) {
  for (const StoredPlace& place : places)
    if (place.drive != claim.drive || std::ranges::count(claim.frames, place.frame) == 0)
      throw UsageError("frame ", place.frame, " of drive '", place.drive,
                       "' is not in this claim, of drive '", claim.drive, "'");
}

std::set<int64_t> ids_to_remove(std::span<const int64_t> ids, int64_t places) {
  for (const int64_t id : ids)
    if (id < 1 || id > places)
      throw UsageError("place ", id, " cannot be removed: the map has had ", places,
                       " places, with the ids 1 to ", places);
  return {ids.begin(), ids.end()};
}

PlaceRow place_row(const StoredPlace& place, DescriptorType format, size_t number) {
  const std::string of = str("place ", number, " of those to add");
  check_drive(place.drive, of + ": ");
  if (place.time && !std::isfinite(*place.time))
    throw UsageError(of, ": its time is not finite: ", *place.time);
  PlaceRow row;
  if (place.pose) {
    const PoseNumbers numbers = place.pose->matrix().topRows<3>();
    if (!numbers.allFinite()) throw UsageError(of, ": its pose has numbers that are not finite");
    row.pose = bytes_of_numbers(numbers.data(), 12);
  }
  row.descriptor = descriptor_bytes(place.descriptor, format, of + ": its descriptor");
  row.feature = float32_bytes(place.feature, of + ": its feature");
  const size_t bytes = row.descriptor.size() + row.feature.size() + place.drive.size();
  if (bytes > sqlite::kMaxBytes - 1000)
    throw UsageError(of, " has ", bytes, " bytes, more than the limit of 256 MB");
  return row;
}

int64_t checksum_of(int64_t id, const RowView& row) {
  return Checksum()
      .number(id)
      .bytes(row.drive)
      .number(row.frame)
      .number(row.time ? 1 : 0)
      .number(std::bit_cast<int64_t>(row.time.value_or(0)))
      .bytes(row.pose)
      .bytes(row.descriptor)
      .bytes(row.feature)
      .number(row.revision)
      .value();
}

RowView view_of(const StoredPlace& place, const PlaceRow& row, int64_t revision) {
  RowView view{place.drive,    place.frame, place.time, row.pose,
               row.descriptor, row.feature, revision,   0};
  if (view.time) *view.time += 0.0;  // databases have no -0
  return view;
}

std::string take_row(int64_t id, const RowView& row, DescriptorType format, int64_t revision,
                     StoredPlace& place) {
  if (checksum_of(id, row) != row.checksum) return "its checksum is wrong";
  if (row.revision != revision) return "it is older than the map's other descriptors";

  // Checksums do not protect against untrusted files.
  const size_t number = format == DescriptorType::kFloat16 ? 2 : 4;
  if (row.descriptor.size() % number != 0 || row.feature.size() % 4 != 0 ||
      (row.pose.size() != 12 * sizeof(double) && !row.pose.empty()))
    return "its columns have impossible lengths";
  place = {.id = id, .drive = std::string(row.drive), .frame = row.frame, .time = row.time};
  if (!row.pose.empty()) {
    const std::vector<double> numbers = numbers_of<double>(row.pose);
    place.pose = Eigen::Isometry3d::Identity();
    place.pose->matrix().topRows<3>() = Eigen::Map<const PoseNumbers>(numbers.data());
  }
  if (format == DescriptorType::kFloat16) {
    const std::vector<Eigen::half> halves = numbers_of<Eigen::half>(row.descriptor);
    place.descriptor.assign(halves.begin(), halves.end());
  } else {
    place.descriptor = numbers_of<float>(row.descriptor);
  }
  place.feature = numbers_of<float>(row.feature);
  if (!std::isfinite(place.time.value_or(0)) || (place.pose && !place.pose->matrix().allFinite()) ||
      !all_finite(place.descriptor) || !all_finite(place.feature))
    return "it has numbers that are not finite";
  if (has_zero_byte(row.drive)) return "the name of its drive has a zero byte";
  return "";
}

void insert_place(sqlite::Statement& insert, int64_t id, const StoredPlace& place,
                  const PlaceRow& row, int64_t revision) {
  const RowView view = view_of(place, row, revision);
  insert.reset().bind(1, view.drive).bind(2, view.frame);
  if (view.time)
    insert.bind(3, *view.time);
  else
    insert.bind_null(3);
  const auto bind_or_null = [&](int parameter, const std::string& bytes) {
    if (bytes.empty())
      insert.bind_null(parameter);
    else
      insert.bind_blob(parameter, bytes);
  };
  bind_or_null(4, row.pose);
  insert.bind_blob(5, row.descriptor);
  bind_or_null(6, row.feature);
  insert.bind(7, revision).bind(8, checksum_of(id, view)).bind(9, id).step();
}

std::string take_row(sqlite::Statement& select, DescriptorType format, int64_t revision,
                     StoredPlace& place) {
  RowView row{.drive = select.bytes(1),
              .frame = select.integer(2),
              .pose = select.bytes(4),
              .descriptor = select.bytes(5),
              .feature = select.bytes(6),
              .revision = select.integer(7),
              .checksum = select.integer(8)};
  if (select.type(3) != SQLITE_NULL) row.time = select.real(3);
  return take_row(select.integer(0), row, format, revision, place);
}

}  // namespace revisit
