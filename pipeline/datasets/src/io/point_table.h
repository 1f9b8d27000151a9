#pragma once

#include <cstddef>
#include <string>
#include <string_view>
#include <vector>

#include "io/file_content.h"
#include "revisit/base/files.h"
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

  /// Decodes binary rows: `points * row_bytes()` bytes at `rows`.
  PointCloud decode_rows(const char* rows, bool big_endian) const;
  /// Decodes binary little-endian columns (PCD's compressed form), of the same size.
  PointCloud decode_columns(const char* columns) const;
  /// Parses text, one line per point; blank lines are skipped. Throws InputError with file:line.
  PointCloud parse_rows(TextCursor* text) const;

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

}  // namespace revisit
