#include "map_format.h"

#include <zlib.h>

#include <Eigen/Core>
#include <algorithm>
#include <bit>
#include <cmath>
#include <cstring>
#include <new>
#include <sstream>

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

using BFloat16 = Eigen::bfloat16;

/// Number of values, uint32, then the deflated bytes: first all exponents, then mantissas and
/// signs. Many values of ring descriptors are 0, and their exponents repeat.
std::string feature_bytes(const std::vector<float>& feature, const std::string& of) {
  const size_t n = feature.size();
  if (n == 0) return "";
  if (n > kMaxFeature)
    throw UsageError(of, " has ", n, " dimensions, more than the limit of ", kMaxFeature);
  std::vector<uint8_t> bytes(2 * n);
  for (size_t i = 0; i < n; ++i) {
    const BFloat16 number(feature[i]);
    if (!(Eigen::numext::isfinite)(number))
      throw UsageError(of, " has numbers that are not finite: ", feature[i]);
    const uint16_t bits = std::rotl(Eigen::numext::bit_cast<uint16_t>(number), 1);
    bytes[i] = static_cast<uint8_t>(bits >> 8);
    bytes[n + i] = static_cast<uint8_t>(bits & 0xFF);
  }
  uLongf size = compressBound(bytes.size());
  std::string result(sizeof(uint32_t) + size, '\0');
  const auto count = static_cast<uint32_t>(n);
  std::memcpy(result.data(), &count, sizeof(count));
  constexpr int kLevel = 4;  // higher ones take twice the time for 3 % less
  if (compress2(reinterpret_cast<Bytef*>(&result[sizeof(count)]), &size, bytes.data(), bytes.size(),
                kLevel) != Z_OK)
    throw std::bad_alloc();
  result.resize(sizeof(count) + size);
  return result;
}

/// Reads feature_bytes(), of a map with this fingerprint. Empty for others.
std::optional<std::vector<float>> feature_from(std::string_view bytes,
                                               const MapFingerprint& fingerprint) {
  std::vector<float> feature;
  if (bytes.empty()) return feature;
  uint32_t n = 0;
  if (bytes.size() <= sizeof(n)) return std::nullopt;
  std::memcpy(&n, bytes.data(), sizeof(n));
  bytes.remove_prefix(sizeof(n));
  // Before memory is allocated: a reader keeps all features of the warm-up.
  const auto dimensions = fingerprint.find(kFeatureDimensions);
  if (n > kMaxFeature || (dimensions != fingerprint.end() && dimensions->second != str(n)))
    return std::nullopt;
  std::vector<uint8_t> halves(2 * size_t{n});
  uLongf size = halves.size();
  if (uncompress(halves.data(), &size, reinterpret_cast<const Bytef*>(bytes.data()),
                 bytes.size()) != Z_OK ||
      size != halves.size())
    return std::nullopt;
  feature.resize(n);
  for (size_t i = 0; i < n; ++i) {
    const auto bits = static_cast<uint16_t>(halves[i] << 8 | halves[n + i]);
    feature[i] = std::bit_cast<float>(uint32_t{std::rotr(bits, 1)} << 16);
  }
  return feature;
}

/// A loop is 34 values of 8 bytes: id of the place, 3 x 4 of the pose, and the upper triangle of
/// the information by rows.
constexpr size_t kLoopBytes = 34 * sizeof(double);

std::string loops_bytes(const MapEntry& entry, const std::string& of) {
  if (entry.loops.empty() && entry.questioned.empty()) return "";
  const int64_t count = std::ssize(entry.loops);
  std::string bytes = bytes_of_numbers(&count, 1);
  for (const MapLoop& loop : entry.loops) {
    const PoseNumbers pose = loop.T_place_query.matrix().topRows<3>();
    std::vector<double> numbers(pose.data(), pose.data() + pose.size());
    for (int row = 0; row < 6; ++row)
      for (int column = row; column < 6; ++column) numbers.push_back(loop.information(row, column));
    if (!std::ranges::all_of(numbers, [](double number) { return std::isfinite(number); }))
      throw UsageError(of, " have numbers that are not finite");
    bytes += bytes_of_numbers(&loop.place, 1) + bytes_of_numbers(numbers.data(), numbers.size());
  }
  return bytes + bytes_of_numbers(entry.questioned.data(), entry.questioned.size());
}

/// Reads loops_bytes(); false for other bytes.
bool read_loops(std::string_view bytes, MapEntry& entry) {
  if (bytes.empty()) return true;
  const auto number = [&bytes] {
    const auto value = numbers_of<int64_t>(bytes.substr(0, sizeof(int64_t))).front();
    bytes.remove_prefix(sizeof(int64_t));
    return value;
  };
  if (bytes.size() % sizeof(int64_t) != 0) return false;
  const int64_t count = number();
  if (count < 0 || static_cast<size_t>(count) > bytes.size() / kLoopBytes) return false;
  for (int64_t i = 0; i < count; ++i) {
    MapLoop& loop = entry.loops.emplace_back(MapLoop{.place = number()});
    const auto numbers = numbers_of<double>(bytes.substr(0, kLoopBytes - sizeof(int64_t)));
    bytes.remove_prefix(kLoopBytes - sizeof(int64_t));
    loop.T_place_query.matrix().topRows<3>() = Eigen::Map<const PoseNumbers>(numbers.data());
    auto next = numbers.begin() + 12;
    for (int row = 0; row < 6; ++row)
      for (int column = row; column < 6; ++column)
        loop.information(row, column) = loop.information(column, row) = *next++;
    if (!loop.T_place_query.matrix().allFinite() || !loop.information.allFinite()) return false;
  }
  entry.questioned = numbers_of<int64_t>(bytes);
  return true;
}

}  // namespace

void round_feature(std::span<float> feature) {
  for (float& number : feature) number = static_cast<float>(BFloat16(number));
}

std::string text_of(const MapFingerprint& fingerprint) {
  std::string text;
  for (const auto& [name, value] : fingerprint) {
    if (name.find('=') != std::string::npos || (name + value).find('\n') != std::string::npos)
      throw UsageError("fingerprint: '", name, "' has a '=' in its name or a line break");
    text += str(name, "=", value, "\n");
  }
  return text;
}

void must_match(const std::string& name, const MapFingerprint& map, const MapFingerprint& program) {
  std::string differences;
  MapFingerprint names = map;
  names.insert(program.begin(), program.end());
  const auto entry = [](const MapFingerprint& fingerprint, const std::string& key) {
    const auto found = fingerprint.find(key);
    return found == fingerprint.end() ? std::string("none") : "'" + found->second + "'";
  };
  for (const auto& [key, value] : names)
    if (entry(map, key) != entry(program, key))
      differences += str("\n  ", key, ": the map has ", entry(map, key), ", this program ",
                         entry(program, key));
  if (!differences.empty())
    throw InputError(name, ": its descriptors differ from those of this program:", differences,
                     "\nuse the map's configuration, or create another map");
}

const char* name_of(DescriptorType type) {
  return type == DescriptorType::kFloat16 ? "float16" : "float32";
}

std::optional<DescriptorType> descriptor_type_of(std::string_view name) {
  for (const DescriptorType type : {DescriptorType::kFloat32, DescriptorType::kFloat16})
    if (name == name_of(type)) return type;
  return std::nullopt;
}

MapFingerprint fingerprint_from(std::string_view text) {
  MapFingerprint fingerprint;
  std::istringstream lines{std::string(text)};
  for (std::string line; std::getline(lines, line);) {
    const size_t equals = line.find('=');
    fingerprint[line.substr(0, equals)] =
        equals == std::string::npos ? "" : line.substr(equals + 1);
  }
  return fingerprint;
}

bool is_usable(std::span<const float> numbers) {
  return std::ranges::all_of(numbers, [](float v) { return std::abs(v) <= kLargest; });
}

std::string misfit_of(const MapEntry& entry, int64_t feature_dim,
                      std::optional<int64_t> descriptor_dim) {
  const bool by_feature = !descriptor_dim || !entry.feature.empty();
  const std::vector<float>& numbers = by_feature ? entry.feature : entry.descriptor;
  const int64_t expected = by_feature ? feature_dim : *descriptor_dim;
  const char* const of = by_feature ? "its feature has " : "its descriptor has ";
  if (std::ssize(numbers) != expected)
    return str(of, numbers.size(), " dimensions, expected ", expected);
  return is_usable(numbers) ? "" : str(of, kTooLarge);
}

void check_drive(const std::string& drive, const std::string& of) {
  if (has_zero_byte(drive))
    throw UsageError(of, "the name of drive '", drive.c_str(),
                     "' has a zero byte after that; remove it");
}

std::set<int64_t> ids_to_remove(std::span<const int64_t> ids, int64_t entries) {
  for (const int64_t id : ids)
    if (id < 1 || id > entries)
      throw UsageError("entry ", id, " cannot be removed: the map has had ", entries,
                       " entries, with the ids 1 to ", entries);
  return {ids.begin(), ids.end()};
}

int64_t checksum_of(std::span<const SqlValue> columns) {
  Checksum sum;
  for (const SqlValue& value : columns)
    if (const auto* integer = std::get_if<int64_t>(&value))
      sum.number(*integer);
    else if (const auto* real = std::get_if<double>(&value))
      sum.number(1).number(std::bit_cast<int64_t>(*real));
    else if (const auto* text = std::get_if<std::string_view>(&value))
      sum.bytes(*text);
    else if (const auto* blob = std::get_if<Blob>(&value))
      sum.bytes(blob->bytes);
    else
      sum.number(0);
  return sum.value();
}

EntryBytes encoded(const MapEntry& entry, DescriptorType format, size_t number) {
  const std::string of = str("entry ", number, " of those to add");
  check_drive(entry.drive, of + ": ");
  if (entry.time && !std::isfinite(*entry.time))
    throw UsageError(of, ": its time is not finite: ", *entry.time);
  EntryBytes bytes;
  if (entry.pose) {
    const PoseNumbers numbers = entry.pose->matrix().topRows<3>();
    if (!numbers.allFinite()) throw UsageError(of, ": its pose has numbers that are not finite");
    bytes.pose = bytes_of_numbers(numbers.data(), 12);
  }
  bytes.descriptor = descriptor_bytes(entry.descriptor, format, of + ": its descriptor");
  bytes.feature = feature_bytes(entry.feature, of + ": its feature");
  bytes.loops = loops_bytes(entry, of + ": its loops");
  const size_t size =
      bytes.descriptor.size() + bytes.feature.size() + bytes.loops.size() + entry.drive.size();
  if (size > kMaxBytes - 1000)
    throw UsageError(of, " has ", size, " bytes, more than the limit of 256 MB");
  return bytes;
}

std::vector<SqlValue> entry_columns(int64_t id, const MapEntry& entry, const EntryBytes& bytes,
                                    int64_t revision) {
  const auto null_if_empty = [](std::string_view value) {
    return value.empty() ? SqlValue(nullptr) : SqlValue(Blob{value});
  };
  return {id,
          entry.drive,
          entry.frame,
          entry.time ? SqlValue(*entry.time + 0.0) : nullptr,  // databases have no -0
          null_if_empty(bytes.pose),
          Blob{bytes.descriptor},
          null_if_empty(bytes.feature),
          revision,
          null_if_empty(bytes.loops)};
}

std::string read_entry(const SqlRow& row, const MapHeader& header, MapEntry& entry) try {
  const size_t last = row.cells.size() - 1;
  if (checksum_of(std::span(row.cells).first(last)) != row.integer(last))
    return "its checksum is wrong";
  if (row.integer(7) != header.revision) return "it is older than the map's other descriptors";

  // Checksums do not protect against untrusted files.
  const std::string_view drive = row.bytes(1), pose = row.bytes(4), descriptor = row.bytes(5);
  if (descriptor.size() % static_cast<size_t>(bytes_of(header.format)) != 0 ||
      (pose.size() != 12 * sizeof(double) && !pose.empty()))
    return "its columns have impossible lengths";
  std::optional<std::vector<float>> feature = feature_from(row.bytes(6), header.fingerprint);
  if (!feature) return "its feature is corrupt or has other dimensions";
  entry = {.id = row.integer(0),
           .drive = std::string(drive),
           .frame = row.integer(2),
           .time = row.real(3)};
  if (!read_loops(row.bytes(8), entry)) return "its loops are corrupt";
  if (!pose.empty()) {
    const std::vector<double> numbers = numbers_of<double>(pose);
    entry.pose = Eigen::Isometry3d::Identity();
    entry.pose->matrix().topRows<3>() = Eigen::Map<const PoseNumbers>(numbers.data());
  }
  if (header.format == DescriptorType::kFloat16) {
    const std::vector<Eigen::half> halves = numbers_of<Eigen::half>(descriptor);
    entry.descriptor.assign(halves.begin(), halves.end());
  } else {
    entry.descriptor = numbers_of<float>(descriptor);
  }
  entry.feature = *std::move(feature);
  if (!std::isfinite(entry.time.value_or(0)) || (entry.pose && !entry.pose->matrix().allFinite()) ||
      !all_finite(entry.descriptor) || !all_finite(entry.feature))
    return "it has numbers that are not finite";
  if (has_zero_byte(drive)) return "the name of its drive has a zero byte";
  return "";
} catch (const InputError&) {
  return "a column has a value of another type";
}

}  // namespace revisit
