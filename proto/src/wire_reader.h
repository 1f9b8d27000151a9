#pragma once

#include <cstdint>

#include "revisit/base/files.h"
#include "revisit/proto/weights_file.h"

namespace revisit::proto {

/// A malformed position in a file. Callers rethrow it as InputError with the path and the field.
struct FormatError : Error {
  template <class... Parts>
  explicit FormatError(uint64_t at, const Parts&... reason) : Error(reason...), offset(at) {}
  uint64_t offset;  // [bytes] from the beginning of the file
};

enum class WireType : uint8_t { kVarint = 0, kFixed64 = 1, kLength = 2, kGroup = 3, kFixed32 = 5 };

struct WireField {
  uint32_t number = 0;
  WireType type = WireType::kVarint;
  uint64_t value = 0;           // varint only
  uint64_t begin = 0, end = 0;  // [bytes] payload, without tag and length

  bool is(uint32_t wanted, WireType wanted_type) const {
    return number == wanted && type == wanted_type;
  }
};

/// Iterates over the fields of the message in [begin, end) of a file without reading payloads.
/// (protobuf encoding: https://protobuf.dev/programming-guides/encoding)
class WireReader {
 public:
  WireReader(FileCursor& cursor, uint64_t begin, uint64_t end)
      : cursor_(cursor), next_(begin), end_(end) {}

  /// Returns false at the end of the message. The cursor may move between calls. Throws FormatError
  /// for fields that exceed the message, illegal tags and unbalanced groups.
  bool next(WireField& field);

 private:
  void read_tag(WireField& field, bool& closes_group);
  void read_extent(WireField& field);
  void skip_group(const WireField& group);

  FileCursor& cursor_;
  uint64_t next_;
  uint64_t end_;
};

/// Reads one varint of a packed field [cursor, end). Throws FormatError.
uint64_t read_varint(FileCursor& cursor, uint64_t end, const char* what);

}  // namespace revisit::proto
