#include "wire_reader.h"

#include <limits>
#include <vector>

#include "revisit/proto/limits.h"

namespace revisit::proto {

uint64_t read_varint(FileCursor& cursor, uint64_t end, const char* what) {
  const uint64_t begin = cursor.position();
  uint64_t value = 0;
  for (int shift = 0; shift < 70; shift += 7) {
    if (cursor.position() >= end) throw FormatError(begin, what, " is truncated");
    const uint8_t byte = cursor.read_byte();
    value |= static_cast<uint64_t>(byte & 0x7f) << shift;
    if (byte < 0x80) return value;
  }
  throw FormatError(begin, what, " is longer than 10 bytes");
}

bool WireReader::next(WireField& field) {
  if (next_ >= end_) return false;
  cursor_.seek(next_);
  bool closes_group = false;
  read_tag(field, closes_group);
  if (closes_group) throw FormatError(next_, "end of a group without its start");
  read_extent(field);
  if (field.type == WireType::kGroup) {
    skip_group(field);
    field.end = cursor_.position();
  }
  next_ = field.end;
  return true;
}

void WireReader::read_tag(WireField& field, bool& closes_group) {
  const uint64_t at = cursor_.position();
  const uint64_t tag = read_varint(cursor_, end_, "a field tag");
  const uint64_t type = tag & 7;
  if (tag > std::numeric_limits<uint32_t>::max() || tag >> 3 == 0 || type > 5)
    throw FormatError(at, "illegal field tag ", tag);
  closes_group = type == 4;
  field.number = static_cast<uint32_t>(tag >> 3);
  field.type = closes_group ? WireType::kGroup : static_cast<WireType>(type);
}

/// Finds the range of the payload; leaves the cursor at its end, or inside the group.
void WireReader::read_extent(WireField& field) {
  const uint64_t at = cursor_.position();
  uint64_t length = 0;
  switch (field.type) {
    case WireType::kVarint:
      field.value = read_varint(cursor_, end_, "a number");
      field.begin = at;
      field.end = cursor_.position();
      return;
    case WireType::kGroup:
      field.begin = field.end = at;
      return;
    case WireType::kFixed64:
      length = 8;
      break;
    case WireType::kFixed32:
      length = 4;
      break;
    case WireType::kLength:
      length = read_varint(cursor_, end_, "a field length");
      break;
  }
  field.begin = cursor_.position();
  if (length > end_ - field.begin)
    throw FormatError(at, "field ", field.number, " needs ", length, " bytes, only ",
                      end_ - field.begin, " are left (is the file truncated?)");
  field.end = field.begin + length;
  cursor_.seek(field.end);
}

void WireReader::skip_group(const WireField& group) {
  std::vector<uint32_t> open = {group.number};
  while (!open.empty()) {
    const uint64_t at = cursor_.position();
    WireField field;
    bool closes_group = false;
    read_tag(field, closes_group);
    if (closes_group) {
      if (field.number != open.back())
        throw FormatError(at, "group ", open.back(), " is closed as ", field.number);
      open.pop_back();
      continue;
    }
    read_extent(field);
    if (field.type != WireType::kGroup) continue;
    if (std::ssize(open) >= kMaxNesting) throw FormatError(at, "groups are nested too deeply");
    open.push_back(field.number);
  }
}

}  // namespace revisit::proto
