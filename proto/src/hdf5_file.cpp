#include "hdf5_file.h"

#include <limits>

namespace revisit::proto {
namespace {

constexpr size_t kHdf5MostAxes = 32;   // HDF5's limit, and Caffe's
constexpr size_t kMaxHdf5Name = 1024;  // [bytes]
constexpr int kMaxTreeLevel = 16;      // levels; each multiplies the number of links
constexpr size_t kMaxPieces = 64;      // per object header
constexpr uint64_t kMaxMessages = 256;

// Types of header messages.
constexpr int kSpace = 0x1, kLinkInfo = 0x2, kType = 0x3, kLink = 0x6, kExternal = 0x7,
              kLayout = 0x8, kContinuation = 0x10, kSymbolTable = 0x11;

constexpr const char* kSaveOlder =
    "; save it in HDF5's earliest format, as Caffe does (h5py: libver='earliest')";
constexpr const char* kSaveWhole = "; save it without chunks and compression, as Caffe does";

}  // namespace

Hdf5File::Hdf5File(FileCursor& cursor, int64_t max_steps)
    : cursor_(cursor), steps_left_(max_steps) {
  check_range(0, 16, "the superblock");
  cursor_.seek(8);
  const int version = cursor_.read_byte();
  if (version > 1) throw Hdf5Unsupported("HDF5 superblock version ", version, kSaveOlder);
  cursor_.seek(13);
  offset_bytes_ = cursor_.read_byte();
  length_bytes_ = cursor_.read_byte();
  for (const int bytes : {offset_bytes_, length_bytes_})
    if (bytes != 2 && bytes != 4 && bytes != 8)
      throw FormatError(13, "found addresses or sizes of ", bytes, " bytes (expected 2, 4 or 8)");
  // Sizes of tree nodes and flags; version 1 has four more bytes of them.
  cursor_.seek(version == 0 ? 24 : 28);
  base_ = read_offset();
  read_offset();  // free space
  const uint64_t end_at = cursor_.position();
  const uint64_t end = read_offset();
  if (end > cursor_.size())
    throw FormatError(end_at, "expected a file of ", end, " bytes, found ", cursor_.size(),
                      " (is it truncated?)");
  read_offset();  // driver information
  read_offset();  // name of the root, which has none
  root_ = read_offset();
}

void Hdf5File::check_range(uint64_t begin, uint64_t length, const char* what) const {
  if (begin <= cursor_.size() && length <= cursor_.size() - begin) return;
  throw FormatError(begin, what, " extends beyond the end of the file (is it truncated?)");
}

void Hdf5File::seek(uint64_t address) {
  uint64_t position = 0;
  if (__builtin_add_overflow(base_, address, &position) || position >= cursor_.size())
    throw FormatError(cursor_.position(), "address ", address, " is beyond the end of the file");
  cursor_.seek(position);
}

uint64_t Hdf5File::read_number(int bytes) {
  check_range(cursor_.position(), static_cast<uint64_t>(bytes), "a number");
  uint64_t value = 0;
  for (int i = 0; i < bytes; ++i) value |= static_cast<uint64_t>(cursor_.read_byte()) << (8 * i);
  return value;
}

std::string Hdf5File::read_signature() {
  std::string signature(4, '\0');
  check_range(cursor_.position(), signature.size(), "a signature");
  cursor_.read(signature.data(), signature.size());
  return signature;
}

bool Hdf5File::is_undefined(uint64_t address) const {
  return address == std::numeric_limits<uint64_t>::max() >> (64 - 8 * offset_bytes_);
}

Hdf5Object Hdf5File::object(uint64_t address) {
  seek(address);
  const uint64_t at = cursor_.position();
  const auto version = read_number(1);
  if (version == 'O') throw Hdf5Unsupported("an HDF5 object of a newer format", kSaveOlder);
  if (version != 1) throw FormatError(at, "expected object header version 1, found ", version);
  read_number(1);
  uint64_t messages = read_number(2);
  if (messages > kMaxMessages)
    throw FormatError(at, "object header with too many messages (", messages, ")");
  read_number(4);  // reference count
  const uint64_t size = read_number(4);
  cursor_.seek(at + 16);

  struct Piece {
    uint64_t begin, length;
  };
  std::vector<Piece> pieces = {{at + 16, size}};
  Hdf5Object object;
  for (size_t i = 0; i < pieces.size(); ++i) {
    check_range(pieces[i].begin, pieces[i].length, "an object header");
    const uint64_t end = pieces[i].begin + pieces[i].length;
    for (uint64_t next = pieces[i].begin; messages > 0 && end - next >= 8; --messages) {
      cursor_.seek(next);
      const int type = static_cast<int>(read_number(2));
      const uint64_t length = read_number(2), flags = read_number(1);
      next += 8;
      if (length > end - next) throw FormatError(next, "header message extends beyond its header");
      cursor_.seek(next);
      if (type == kContinuation) {
        seek(read_offset());
        const uint64_t begin = cursor_.position();
        cursor_.seek(next + static_cast<uint64_t>(offset_bytes_));
        if (pieces.size() == kMaxPieces) throw FormatError(next, "too many header continuations");
        pieces.push_back({begin, read_length()});
      } else if ((flags & 2) != 0 && (type == kSpace || type == kType)) {
        object.unsupported = "its type is stored elsewhere in the file";
      } else {
        read_message(type, next + length, object);
      }
      next += length;
    }
  }
  return object;
}

void Hdf5File::read_message(int type, uint64_t end, Hdf5Object& object) {
  const uint64_t begin = cursor_.position();
  switch (type) {
    case kSymbolTable:
      object.is_group = true;
      object.tree = read_offset();
      object.heap = read_offset();
      break;
    case kLinkInfo:
    case kLink:
      throw Hdf5Unsupported("an HDF5 group of a newer format", kSaveOlder);
    case kSpace:
      read_space(object, end);
      break;
    case kType:
      read_type(object);
      break;
    case kLayout:
      object.is_array = true;
      read_layout(object);
      break;
    case kExternal:
      object.unsupported = "its values are in another file";
      break;
    default:
      return;  // times, comments, fill values, attributes
  }
  if (cursor_.position() > end) throw FormatError(begin, "header message ", type, " is too short");
}

void Hdf5File::read_space(Hdf5Object& object, uint64_t end) {
  const uint64_t at = cursor_.position();
  const uint64_t version = read_number(1), rank = read_number(1);
  read_number(1);  // flags
  const uint64_t kind = read_number(1);
  if (version == 2 && kind == 2) throw FormatError(at, "array without a shape");
  if (version != 1 && version != 2) throw FormatError(at, "unknown dataspace version ", version);
  if (version == 1) read_number(4);
  if (rank > kHdf5MostAxes) throw FormatError(at, "array of ", rank, " axes");
  if (cursor_.position() > end) throw FormatError(at, "dataspace is too short");
  object.shape.clear();
  for (uint64_t axis = 0; axis < rank; ++axis)
    object.shape.push_back(static_cast<int64_t>(read_length()));
}

void Hdf5File::read_type(Hdf5Object& object) {
  constexpr int kInteger = 0, kFloat = 1;
  const int kind = static_cast<int>(read_number(1)) & 15;
  const uint64_t bits = read_number(3);
  NumberType& number = object.number;
  number.bytes = read_number(4);
  number.big_endian = (bits & 1) != 0;
  if (kind != kInteger && kind != kFloat) return;
  const uint64_t first_bit = read_number(2), precision = read_number(2);
  if (first_bit != 0 || precision != 8 * number.bytes) return;
  if (kind == kInteger) {
    number.kind = (bits & 8) != 0 ? 'i' : 'u';
    return;
  }
  read_number(1);  // position of the exponent
  const uint64_t exponent_bits = read_number(1);
  read_number(1);  // position of the mantissa
  const uint64_t mantissa_bits = read_number(1), bias = read_number(4);
  const bool vax = (bits & 0x40) != 0;
  const bool single = number.bytes == 4 && exponent_bits == 8 && mantissa_bits == 23 && bias == 127;
  const bool wide = number.bytes == 8 && exponent_bits == 11 && mantissa_bits == 52 && bias == 1023;
  if (!vax && (single || wide)) number.kind = 'f';
}

void Hdf5File::read_layout(Hdf5Object& object) {
  enum { kCompact, kContiguous };
  const uint64_t at = cursor_.position();
  const uint64_t version = read_number(1), kind = read_number(1);
  if (version != 3 && version != 4)
    throw Hdf5Unsupported("an HDF5 array with a layout of version ", version, kSaveOlder);
  if (kind == kCompact) {
    object.stored = read_number(2);
    object.begin = cursor_.position();
    object.is_written = true;
    cursor_.seek(object.begin + object.stored);
  } else if (kind == kContiguous) {
    const uint64_t address = read_offset();
    object.stored = read_length();
    if (is_undefined(address)) return;
    if (__builtin_add_overflow(base_, address, &object.begin))
      throw FormatError(at, "array beyond the end of the file");
    object.is_written = true;
  } else if (object.unsupported.empty()) {
    object.unsupported = str("its values are in chunks or compressed", kSaveWhole);
  }
}

const Hdf5Links& Hdf5File::links(uint64_t address) {
  const auto [entry, is_new] = links_.try_emplace(address);
  if (!is_new) return entry->second;
  const Hdf5Object group = object(address);
  if (!group.is_group) throw FormatError(base_ + address, "expected a group");
  std::set<uint64_t> seen;
  read_tree(group.tree, -1, group, seen, entry->second);
  return entry->second;
}

void Hdf5File::spend(int64_t steps) {
  steps_left_ -= steps;
  if (steps_left_ < 0)
    throw FormatError(cursor_.position(), "too many links (raise the limit of layers)");
}

/// `level` is -1 for the root.
void Hdf5File::read_tree(uint64_t address, int level, const Hdf5Object& group,
                         std::set<uint64_t>& seen, Hdf5Links& links) {
  seek(address);
  const uint64_t at = cursor_.position();
  if (!seen.insert(at).second) throw FormatError(at, "cycle in a tree of links");
  if (read_signature() != "TREE") throw FormatError(at, "expected a tree of links (TREE)");
  const uint64_t kind = read_number(1);
  const int found = static_cast<int>(read_number(1));
  if (kind != 0 || found > kMaxTreeLevel || (level >= 0 && found != level))
    throw FormatError(at, "unexpected tree node of kind ", kind, " and level ", found);
  const uint64_t children = read_number(2);
  spend(1);
  read_offset();  // left sibling
  read_offset();  // right sibling
  uint64_t next = cursor_.position();
  for (uint64_t i = 0; i < children; ++i) {
    cursor_.seek(next);
    read_length();  // last name of the previous child
    const uint64_t child = read_offset();
    next = cursor_.position();
    if (found > 0)
      read_tree(child, found - 1, group, seen, links);
    else
      read_symbols(child, group, links);
  }
}

void Hdf5File::read_symbols(uint64_t address, const Hdf5Object& group, Hdf5Links& links) {
  constexpr uint64_t kSoft = 2;
  seek(address);
  const uint64_t at = cursor_.position();
  if (read_signature() != "SNOD") throw FormatError(at, "expected a table of links (SNOD)");
  read_number(2);  // version
  const uint64_t count = read_number(2);
  spend(1 + static_cast<int64_t>(count));
  uint64_t next = cursor_.position();
  for (uint64_t i = 0; i < count; ++i) {
    cursor_.seek(next);
    const uint64_t name = read_offset();
    Hdf5Link link;
    link.object = read_offset();
    const uint64_t kind = read_number(4);
    read_number(4);
    const uint64_t target = read_number(4);
    next = cursor_.position() + 12;
    if (kind == kSoft) link.target = read_name(group.heap, target);
    links.try_emplace(read_name(group.heap, name), std::move(link));
  }
}

std::string Hdf5File::read_name(uint64_t heap, uint64_t offset) {
  seek(heap);
  const uint64_t at = cursor_.position();
  if (read_signature() != "HEAP") throw FormatError(at, "expected a heap of names (HEAP)");
  read_number(4);  // version
  const uint64_t size = read_length();
  read_length();  // offset of the free list
  seek(read_offset());
  check_range(cursor_.position(), size, "a heap of names");
  if (offset >= size) throw FormatError(at, "name ", offset, " is beyond its heap of ", size);
  cursor_.seek(cursor_.position() + offset);
  std::string name;
  for (uint64_t left = size - offset; left > 0; --left) {
    const auto c = static_cast<char>(cursor_.read_byte());
    if (c == '\0') return name;
    if (name.size() == kMaxHdf5Name) throw FormatError(at, "name exceeds ", kMaxHdf5Name, " bytes");
    name += c;
  }
  throw FormatError(at, "unterminated name");
}

}  // namespace revisit::proto
