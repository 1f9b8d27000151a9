#pragma once

#include <cstdint>
#include <map>
#include <set>
#include <string>
#include <vector>

#include "revisit/base/files.h"
#include "revisit/proto/weights_file.h"
#include "wire_reader.h"

namespace revisit::proto {

/// Valid HDF5 feature without support here; becomes an UnsupportedError.
struct Hdf5Unsupported : Error {
  using Error::Error;
};

/// Object header: `tree` and `heap` for a group, the other fields for an array.
struct Hdf5Object {
  bool is_group = false, is_array = false;
  uint64_t tree = 0, heap = 0;  // addresses

  std::vector<int64_t> shape;
  NumberType number;
  bool is_written = false;         // the file has `stored` bytes at `begin`
  uint64_t begin = 0, stored = 0;  // [bytes]
  std::string unsupported;         // reason why the values cannot be read, or ""
};

struct Hdf5Link {
  uint64_t object = 0;  // address of its header
  std::string target;   // path of a soft link, instead of `object`
};

using Hdf5Links = std::map<std::string, Hdf5Link>;

/// Reads the format that Caffe writes: superblock 0 or 1, groups as symbol tables, contiguous
/// arrays. The HDF5 library (1.10.8) is not used, because a corrupt file can make it allocate all
/// memory. (https://docs.hdfgroup.org/documentation/hdf5/latest/_f_m_t11.html)
class Hdf5File {
 public:
  /// `max_steps` bounds the cost of untrusted files.
  Hdf5File(FileCursor& cursor, int64_t max_steps);

  uint64_t root() const { return root_; }
  Hdf5Object object(uint64_t address);
  const Hdf5Links& links(uint64_t address);
  /// Counts links, tree nodes and parts of soft links. Throws FormatError above `max_steps`.
  void spend(int64_t steps);

 private:
  void seek(uint64_t address);
  void check_range(uint64_t begin, uint64_t length, const char* what) const;
  uint64_t read_number(int bytes);
  uint64_t read_offset() { return read_number(offset_bytes_); }
  uint64_t read_length() { return read_number(length_bytes_); }
  std::string read_signature();
  bool is_undefined(uint64_t address) const;

  void read_message(int type, uint64_t end, Hdf5Object& object);
  void read_space(Hdf5Object& object, uint64_t end);
  void read_type(Hdf5Object& object);
  void read_layout(Hdf5Object& object);
  void read_tree(uint64_t address, int level, const Hdf5Object& group, std::set<uint64_t>& seen,
                 Hdf5Links& links);
  void read_symbols(uint64_t address, const Hdf5Object& group, Hdf5Links& links);
  std::string read_name(uint64_t heap, uint64_t offset);

  FileCursor& cursor_;
  int offset_bytes_ = 8, length_bytes_ = 8;
  uint64_t base_ = 0;  // [bytes] base of all addresses
  uint64_t root_ = 0;
  int64_t steps_left_;
  std::map<uint64_t, Hdf5Links> links_;  // by address of the group
};

bool is_hdf5(std::string_view head);

/// Opens weights in Caffe's HDF5 layout: an array `/data/LAYER/INDEX` for each blob.
std::unique_ptr<WeightsFile> open_hdf5(FileCursor cursor, const Limits& limits);

}  // namespace revisit::proto
