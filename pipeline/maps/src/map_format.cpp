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

EntryRow entry_row(const MapEntry& entry, DescriptorType format, size_t number) {
  const std::string of = str("entry ", number, " of those to add");
  check_drive(entry.drive, of + ": ");
  if (entry.time && !std::isfinite(*entry.time))
    throw UsageError(of, ": its time is not finite: ", *entry.time);
  EntryRow row{.drive = entry.drive, .frame = entry.frame, .time = entry.time};
  if (row.time) *row.time += 0.0;  // databases have no -0
  if (entry.pose) {
    const PoseNumbers numbers = entry.pose->matrix().topRows<3>();
    if (!numbers.allFinite()) throw UsageError(of, ": its pose has numbers that are not finite");
    row.pose = bytes_of_numbers(numbers.data(), 12);
  }
  row.descriptor = descriptor_bytes(entry.descriptor, format, of + ": its descriptor");
  row.feature = feature_bytes(entry.feature, of + ": its feature");
  const size_t bytes = row.descriptor.size() + row.feature.size() + entry.drive.size();
  if (bytes > kMaxBytes - 1000)
    throw UsageError(of, " has ", bytes, " bytes, more than the limit of 256 MB");
  return row;
}

int64_t checksum_of(int64_t id, const EntryRow& row) {
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

std::string take_row(int64_t id, const EntryRow& row, const MapHeader& header, MapEntry& entry) {
  if (checksum_of(id, row) != row.checksum) return "its checksum is wrong";
  if (row.revision != header.revision) return "it is older than the map's other descriptors";

  // Checksums do not protect against untrusted files.
  if (row.descriptor.size() % static_cast<size_t>(bytes_of(header.format)) != 0 ||
      (row.pose.size() != 12 * sizeof(double) && !row.pose.empty()))
    return "its columns have impossible lengths";
  std::optional<std::vector<float>> feature = feature_from(row.feature, header.fingerprint);
  if (!feature) return "its feature is corrupt or has other dimensions";
  entry = {.id = id, .drive = row.drive, .frame = row.frame, .time = row.time};
  if (!row.pose.empty()) {
    const std::vector<double> numbers = numbers_of<double>(row.pose);
    entry.pose = Eigen::Isometry3d::Identity();
    entry.pose->matrix().topRows<3>() = Eigen::Map<const PoseNumbers>(numbers.data());
  }
  if (header.format == DescriptorType::kFloat16) {
    const std::vector<Eigen::half> halves = numbers_of<Eigen::half>(row.descriptor);
    entry.descriptor.assign(halves.begin(), halves.end());
  } else {
    entry.descriptor = numbers_of<float>(row.descriptor);
  }
  entry.feature = *std::move(feature);
  if (!std::isfinite(entry.time.value_or(0)) || (entry.pose && !entry.pose->matrix().allFinite()) ||
      !all_finite(entry.descriptor) || !all_finite(entry.feature))
    return "it has numbers that are not finite";
  if (has_zero_byte(row.drive)) return "the name of its drive has a zero byte";
  return "";
}

}  // namespace revisit
