#pragma once

#include <cstddef>
#include <filesystem>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "io/file_content.h"
#include "revisit/base/files.h"
#include "revisit/datasets/scan_file.h"
#include "revisit/recognition/point_cloud.h"

namespace revisit {

/// Parses an integer 0..2^32-1, the largest count in these formats. Throws InputError.
size_t parse_count(std::string_view word, const std::string& where);

class PointTable {
 public:
  /// `count` values per row; number_reader() must know the type.
  void add(std::string_view name, NumberType type, size_t count);
  /// Throws InputError, starting with `where`, unless x, y and z exist as single values.
  void check(const std::string& where) const;

  size_t points = 0;
  size_t row_bytes() const { return row_bytes_; }

  /// Columns, one after the other and little-endian, are PCD's compressed form.
  enum class Layout { kRows, kBigEndianRows, kColumns };
  /// Decodes `points * row_bytes()` bytes. Times are returned apart.
  PointCloud decode(const char* data, Layout layout, RecordedTimes& times) const;
  /// Parses text, one line per point; blank lines are skipped. Throws InputError with file:line.
  PointCloud parse_rows(TextCursor* text, RecordedTimes& times) const;

 private:
  struct Column {
    std::string name;
    NumberType type;  // little-endian
    size_t count;
    size_t offset;  // [bytes], in a row
    size_t index;   // [values], in a row
  };
  const Column* find(std::string_view name) const;
  const Column* find_time() const;

  std::vector<Column> columns_;
  size_t row_bytes_ = 0, row_values_ = 0;
};

// These readers replace PCL's (1.13), which accept garbage and size their buffers by unchecked
// headers. Only LZF is a library.

/// Reads PCL's Point Cloud Data 0.6 and 0.7: ascii, binary, binary_compressed. Throws InputError.
PointCloud read_pcd(const std::filesystem::path& file, RecordedTimes& times);

/// Reads the vertices of a Stanford PLY 1.0: ascii, binary of either byte order. Throws InputError.
PointCloud read_ply(const std::filesystem::path& file, RecordedTimes& times);

/// Layout of the points in a headerless .bin file: x, y, z, then other values.
struct BinLayout {
  size_t numbers = 4;  // values per point
  bool doubles = false;
  size_t bytes() const { return numbers * (doubles ? 8 : 4); }
};

double number_at(std::span<const std::byte> content, const BinLayout& layout, size_t point,
                 size_t column);

/// Detects the layout of a file: 3 to 6 float32 or float64 values per point. Values of one kind
/// (heights, intensities, channels) have similar magnitudes. Only under the correct layout do
/// magnitudes vary less within a column than over all values. Returns KITTI's layout if the content
/// is ambiguous.
BinLayout find_bin_layout(std::span<const std::byte> content);

}  // namespace revisit
