#include "revisit/proto/weights_file.h"

#include <algorithm>
#include <array>
#include <bit>
#include <limits>
#include <optional>
#include <string_view>
#include <type_traits>

#include "downloads.h"
#include "hdf5_file.h"
#include "revisit/base/text.h"
#include "wire_reader.h"

static_assert(std::endian::native == std::endian::little, "the wire format is little-endian");

namespace revisit::proto {
namespace {

namespace fs = std::filesystem;

// [bytes] protobuf's limit.
constexpr int64_t kMaxBinaryBytes = std::numeric_limits<int32_t>::max();
constexpr int64_t kBlobsPerLayer = 10;         // on average; bounds the index of an untrusted file
constexpr uint64_t kMaxLayerName = 64 * 1024;  // [bytes]

// Field numbers in the layer messages of the three generations.
struct LayerFields {
  uint32_t name, blobs;
};
constexpr LayerFields kV0 = {1, 50};
constexpr LayerFields kV1 = {4, 6};
constexpr LayerFields kV2 = {1, 7};
constexpr uint32_t kV0InsideV1 = 1;
// NetParameter.
constexpr uint32_t kV1Layers = 2, kV2Layer = 100;

// Field numbers of BlobProto and BlobShape.
constexpr uint32_t kNum = 1, kWidth = 4, kData = 5, kShape = 7, kDoubleData = 8, kRawDataType = 10,
                   kRawData = 12, kDim = 1, kWidthOfC3d = 5, kDataOfC3d = 6, kAllSizesOfC3d = 31;

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

/// Decodes the BlobProto at [begin, end) of a file, in any legal encoding: packed, unpacked or
/// chunked numbers, float or double, legacy or current shape, fields in any order; without those
/// numbers, raw_data. Skips gradients. Throws FormatError, also above kMaxElements.
Blob read_blob(FileCursor& cursor, uint64_t begin, uint64_t end) {
  Blob blob;
  // num, channels, height, width; C3D has 5 numbers, num, channels, length, height, width, and its
  // data in the field of gradients.
  std::array<int32_t, 5> legacy{};
  uint32_t sizes_seen = 0;  // a bit per number
  std::vector<float> doubles;
  std::optional<WireField> raw;
  uint64_t raw_type = 0;
  WireReader reader(cursor, begin, end);
  for (WireField field; reader.next(field);) {
    const bool is_run = field.type == WireType::kLength;
    const bool is_data =
        field.number == kData || (field.number == kDataOfC3d && sizes_seen == kAllSizesOfC3d);
    if (field.type == WireType::kVarint && field.number >= kNum && field.number <= kWidthOfC3d) {
      legacy[field.number - kNum] = static_cast<int32_t>(field.value);
      blob.legacy_shape |= field.number != kWidthOfC3d;
      sizes_seen |= 1U << (field.number - kNum);
    } else if (is_data && (is_run || field.type == WireType::kFixed32)) {
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
  if (blob.legacy_shape)
    blob.shape.assign(legacy.begin(), legacy.end() - (sizes_seen == kAllSizesOfC3d ? 0 : 1));
  if (!doubles.empty()) blob.data = std::move(doubles);
  if (raw && blob.data.empty()) append_raw(cursor, *raw, raw_type, blob.data);

  const int64_t wanted = count_elements(blob.shape, begin);
  if (static_cast<uint64_t>(wanted) != blob.data.size())
    throw FormatError(begin, "shape ", shape_text(blob.shape),
                      blob.shape.empty() ? " (none given)" : "", " needs ", wanted,
                      " values, found ", blob.data.size());
  return blob;
}

struct Range {
  uint64_t begin, end;  // [bytes]
};

InputError malformed(const FileCursor& cursor, const FormatError& error, const std::string& where) {
  return InputError(cursor.file().string(), ": byte ", error.offset, ": ", where, error);
}

void check_size(const FileCursor& cursor, const Limits& limits) {
  const auto size = static_cast<int64_t>(cursor.size());
  if (size <= limits.weight_bytes) return;
  throw InputError(cursor.file().string(), ": is ", size, " bytes, more than the limit of ",
                   limits.weight_bytes >> 20, " MB (raise the limit of weights)");
}

void check_binary_size(const FileCursor& cursor, const char* what) {
  if (static_cast<int64_t>(cursor.size()) <= kMaxBinaryBytes) return;
  throw InputError(cursor.file().string(), ": is ", cursor.size(), " bytes; ", what,
                   " has at most ", kMaxBinaryBytes,
                   ", protobuf's limit (use HDF5 for larger weights)");
}

std::string read_head(FileCursor& cursor) {
  std::string head(std::min<uint64_t>(cursor.size(), 256), '\0');
  cursor.seek(0);
  cursor.read(head.data(), head.size());
  return head;
}

bool is_text(std::string_view head) {
  return std::ranges::all_of(head, [](char c) {
    const auto byte = static_cast<unsigned char>(c);
    return (byte >= 0x20 && byte != 0x7f) || c == '\n' || c == '\r' || c == '\t' || c == '\f';
  });
}

class Caffemodel final : public WeightsFile {
 public:
  Caffemodel(FileCursor cursor, const Limits& limits) : WeightsFile(std::move(cursor), limits) {
    index();
  }

  std::vector<Blob> read(size_t index) override {
    const std::vector<Range>& ranges = blobs_.at(index);
    std::vector<Blob> blobs;
    blobs.reserve(ranges.size());
    for (const Range& range : ranges) {
      try {
        blobs.push_back(read_blob(cursor_, range.begin, range.end));
      } catch (const FormatError& error) {
        throw malformed(cursor_, error,
                        str("layer '", layers_[index].name, "', blob ", blobs.size(), ": "));
      }
    }
    return blobs;
  }

 private:
  void index() {
    const std::string path = cursor_.file().string();
    if (cursor_.size() == 0) throw InputError(path, ": is empty, expected a caffemodel");
    check_binary_size(cursor_, "a caffemodel");
    const std::string head = read_head(cursor_);
    if (const std::string wrong = wrong_download(head); !wrong.empty())
      throw InputError(path, ": ", wrong, " (expected a caffemodel)");
    const std::string not_binary =
        str(path, ": is text, expected a binary caffemodel (a prototxt in its place?)");
    try {
      index_net();
    } catch (const FormatError& error) {
      if (is_text(head)) throw InputError(not_binary);
      const std::string layer =
          layers_.empty() ? "" : str("after layer '", layers_.back().name, "': ");
      throw malformed(cursor_, error, layer + "not a caffemodel, or a corrupt one: ");
    }
    if (layers_.empty())
      throw InputError(is_text(head) ? not_binary
                                     : str(path, ": holds no layers, expected a caffemodel"));
  }

  void index_net() {
    uint64_t v1_at = 0, v2_at = 0;
    WireReader reader(cursor_, 0, cursor_.size());
    for (WireField field; reader.next(field);) {
      const bool v1 = field.is(kV1Layers, WireType::kLength);
      const bool v2 = field.is(kV2Layer, WireType::kLength);
      if (!v1 && !v2) continue;
      (v1 ? v1_at : v2_at) = field.begin;
      if (v1_at != 0 && v2_at != 0)
        throw FormatError(field.begin, "has both V1 `layers` and V2 `layer`; Caffe reads neither");
      if (static_cast<int64_t>(layers_.size()) == limits_.layers)
        throw FormatError(field.begin, "more than ", limits_.layers,
                          " layers (raise the limit of layers)");
      Layer layer;
      std::vector<Range> blobs;
      const bool is_v0 = v1 && index_v0(field, layer, blobs);
      if (!is_v0) index_layer(field, v1 ? kV1 : kV2, layer, blobs);
      layer.n_blobs = blobs.size();
      layers_.push_back(std::move(layer));
      blobs_.push_back(std::move(blobs));
    }
  }

  /// Returns whether the V1 layer wraps a V0 layer; only the V0 layer counts then, as in Caffe.
  bool index_v0(const WireField& v1, Layer& layer, std::vector<Range>& blobs) {
    bool found = false;
    WireReader reader(cursor_, v1.begin, v1.end);
    for (WireField field; reader.next(field);) {
      if (!field.is(kV0InsideV1, WireType::kLength)) continue;
      index_layer(field, kV0, layer, blobs);
      found = true;
    }
    return found;
  }

  void index_layer(const WireField& message, const LayerFields& numbers, Layer& layer,
                   std::vector<Range>& blobs) {
    WireReader reader(cursor_, message.begin, message.end);
    for (WireField field; reader.next(field);) {
      if (field.is(numbers.name, WireType::kLength)) layer.name = read_string(field);
      if (!field.is(numbers.blobs, WireType::kLength)) continue;
      if (++n_blobs_ > limits_.layers * kBlobsPerLayer)
        throw FormatError(field.begin, "more than ", limits_.layers * kBlobsPerLayer,
                          " blobs (raise the limit of layers, ", kBlobsPerLayer,
                          " for each layer)");
      blobs.push_back({field.begin, field.end});
    }
  }

  std::string read_string(const WireField& field) {
    const uint64_t length = field.end - field.begin;
    if (length > kMaxLayerName)
      throw FormatError(field.begin, "a layer name of ", length, " bytes");
    std::string text(length, '\0');
    cursor_.seek(field.begin);
    cursor_.read(text.data(), length);
    return text;
  }

  std::vector<std::vector<Range>> blobs_;  // [layer][blob]
  int64_t n_blobs_ = 0;
};

}  // namespace

std::unique_ptr<WeightsFile> WeightsFile::open(const fs::path& file, const Limits& limits) {
  return open(FileCursor(file), limits);
}

std::unique_ptr<WeightsFile> WeightsFile::open(FileCursor cursor, const Limits& limits) {
  check_size(cursor, limits);
  if (is_hdf5(read_head(cursor))) return open_hdf5(std::move(cursor), limits);
  return std::make_unique<Caffemodel>(std::move(cursor), limits);
}

Blob read_binaryproto(const fs::path& file, const Limits& limits) {
  FileCursor cursor(file);
  check_size(cursor, limits);
  check_binary_size(cursor, "a binaryproto");
  if (const std::string wrong = wrong_download(read_head(cursor)); !wrong.empty())
    throw InputError(file.string(), ": ", wrong, " (expected a binaryproto)");
  try {
    Blob blob = read_blob(cursor, 0, cursor.size());
    if (blob.data.empty()) throw FormatError(0, "it holds no values");
    return blob;
  } catch (const FormatError& error) {
    throw malformed(cursor, error, "not a binaryproto (one BlobProto), or a corrupt one: ");
  }
}

}  // namespace revisit::proto
