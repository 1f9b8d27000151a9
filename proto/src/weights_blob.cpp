#include <algorithm>
#include <array>
#include <bit>
#include <optional>
#include <type_traits>

#include "revisit/base/text.h"
#include "revisit/proto/limits.h"
#include "wire_reader.h"

static_assert(std::endian::native == std::endian::little, "the wire format is little-endian");

namespace revisit::proto {
namespace {

// Field numbers of BlobProto and BlobShape.
constexpr uint32_t kNum = 1, kWidth = 4, kData = 5, kShape = 7, kDoubleData = 8, kRawDataType = 10,
                   kRawData = 12, kDim = 1;

/// IEEE 754 binary16.
struct Half {
  uint16_t bits;
  explicit operator float() const {
    const uint32_t sign = uint32_t{bits} >> 15 << 31, exponent = bits >> 10 & 31;
    const uint32_t mantissa = bits & 1023;
    if (exponent == 0) {  // subnormal
      const float value = static_cast<float>(mantissa) * 0x1p-24F;
      return sign == 0 ? value : -value;
    }
    const uint32_t wide = exponent == 31 ? 255 : exponent + 112;
    return std::bit_cast<float>(sign | wide << 23 | mantissa << 13);
  }
};

template <class Number>
void append(FileCursor& cursor, const WireField& field, std::vector<float>& out) {
  const uint64_t bytes = field.end - field.begin;
  if (bytes % sizeof(Number) != 0)
    throw FormatError(field.begin, "packed field of ", bytes, " bytes is not a multiple of ",
                      sizeof(Number), "-byte values");
  cursor.seek(field.begin);
  const size_t count = bytes / sizeof(Number);
  const size_t before = out.size();
  if constexpr (std::is_same_v<Number, float>) {
    out.resize(before + count);
    cursor.read(out.data() + before, bytes);
  } else {
    std::array<Number, 4096> chunk;
    for (size_t done = 0; done < count;) {
      const size_t n = std::min(chunk.size(), count - done);
      cursor.read(chunk.data(), n * sizeof(Number));
      for (size_t i = 0; i < n; ++i) out.push_back(static_cast<float>(chunk[i]));
      done += n;
    }
  }
}

void append_raw(FileCursor& cursor, const WireField& field, uint64_t type,
                std::vector<float>& out) {
  if (type == 0) return append<double>(cursor, field, out);
  if (type == 1) return append<float>(cursor, field, out);
  if (type == 2) return append<Half>(cursor, field, out);
  throw FormatError(field.begin, "unsupported raw_data_type ", type,
                    "; expected 0 (double), 1 (float) or 2 (float16)");
}

void append_dim(uint64_t value, uint64_t offset, std::vector<int64_t>& shape) {
  if (shape.size() == kMaxAxes)
    throw FormatError(offset, "shape has more than ", kMaxAxes, " axes");
  shape.push_back(static_cast<int64_t>(value));
}

void append_shape(FileCursor& cursor, const WireField& message, std::vector<int64_t>& shape) {
  WireReader reader(cursor, message.begin, message.end);
  for (WireField field; reader.next(field);) {
    if (field.is(kDim, WireType::kVarint)) append_dim(field.value, field.begin, shape);
    if (!field.is(kDim, WireType::kLength)) continue;
    cursor.seek(field.begin);
    while (cursor.position() < field.end) {
      const uint64_t at = cursor.position();
      append_dim(read_varint(cursor, field.end, "a dimension"), at, shape);
    }
  }
}

int64_t count_elements(const std::vector<int64_t>& shape, uint64_t offset) {
  int64_t count = 1;
  for (const int64_t dim : shape) {
    if (dim < 0) throw FormatError(offset, "negative dimension in shape ", shape_text(shape));
    if (count != 0 && dim > kMaxElements / count)
      throw FormatError(offset, "shape ", shape_text(shape), " has more than ", kMaxElements,
                        " elements");
    count *= dim;
  }
  return count;
}

}  // namespace

Blob read_blob(FileCursor& cursor, uint64_t begin, uint64_t end) {
  Blob blob;
  std::array<int32_t, 4> legacy{};
  std::vector<float> doubles;
  std::optional<WireField> raw;
  uint64_t raw_type = 0;
  WireReader reader(cursor, begin, end);
  for (WireField field; reader.next(field);) {
    const bool is_run = field.type == WireType::kLength;
    if (field.type == WireType::kVarint && field.number >= kNum && field.number <= kWidth) {
      legacy[field.number - kNum] = static_cast<int32_t>(field.value);
      blob.legacy_shape = true;
    } else if (field.number == kData && (is_run || field.type == WireType::kFixed32)) {
      append<float>(cursor, field, blob.data);
    } else if (field.number == kDoubleData && (is_run || field.type == WireType::kFixed64)) {
      append<double>(cursor, field, doubles);
    } else if (field.is(kRawDataType, WireType::kVarint)) {
      raw_type = field.value;
    } else if (field.is(kRawData, WireType::kLength)) {
      raw = field;
    } else if (field.is(kShape, WireType::kLength)) {
      append_shape(cursor, field, blob.shape);
    }
  }
  if (blob.legacy_shape) blob.shape.assign(legacy.begin(), legacy.end());
  if (!doubles.empty()) blob.data = std::move(doubles);
  if (raw && blob.data.empty()) append_raw(cursor, *raw, raw_type, blob.data);

  const int64_t wanted = count_elements(blob.shape, begin);
  if (static_cast<uint64_t>(wanted) != blob.data.size())
    throw FormatError(begin, "shape ", shape_text(blob.shape),
                      blob.shape.empty() ? " (none given)" : "", " needs ", wanted,
                      " values, found ", blob.data.size());
  return blob;
}

}  // namespace revisit::proto
