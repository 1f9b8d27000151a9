#pragma once

#include <cstdint>
#include <cstring>
#include <string>
#include <vector>

namespace revisit::test {

/// Encodes protobuf's wire format by hand, for encodings that no library writes
/// (https://protobuf.dev/programming-guides/encoding).
inline std::string varint(uint64_t value) {
  std::string bytes;
  for (; value >= 0x80; value >>= 7) bytes += static_cast<char>(value | 0x80);
  return bytes + static_cast<char>(value);
}
inline std::string tag(uint32_t number, uint32_t wire_type) {
  return varint(number << 3 | wire_type);
}
inline std::string varint_field(uint32_t number, uint64_t value) {
  return tag(number, 0) + varint(value);
}
inline std::string bytes_field(uint32_t number, const std::string& bytes) {
  return tag(number, 2) + varint(bytes.size()) + bytes;
}
template <class Number>
std::string raw(const std::vector<Number>& values) {
  std::string bytes(values.size() * sizeof(Number), '\0');
  if (!values.empty()) std::memcpy(bytes.data(), values.data(), bytes.size());
  return bytes;
}

inline std::string shape(const std::vector<uint64_t>& dims) {
  std::string packed;
  for (const uint64_t dim : dims) packed += varint(dim);
  return bytes_field(7, bytes_field(1, packed));
}
inline std::string packed_data(const std::vector<float>& values) {
  return bytes_field(5, raw(values));
}
inline std::string unpacked_data(const std::vector<float>& values) {
  std::string bytes;
  for (const float value : values) bytes += tag(5, 5) + raw<float>({value});
  return bytes;
}

/// Returns a caffemodel with one V2 layer `c`, a Convolution with these encoded blobs.
inline std::string model_of(const std::vector<std::string>& blobs) {
  std::string layer = bytes_field(1, "c") + bytes_field(2, "Convolution");
  for (const std::string& blob : blobs) layer += bytes_field(7, blob);
  return bytes_field(1, "net") + bytes_field(100, layer);
}

}  // namespace revisit::test
