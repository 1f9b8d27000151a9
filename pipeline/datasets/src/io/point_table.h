#pragma once

#include <cstddef>
#include <string>
#include <string_view>
#include <vector>

#include "io/file_content.h"
#include "revisit/proto/number_type.h"
#include "revisit/recognition/point_cloud.h"

namespace revisit::pipeline {

/// A word as a whole number 0..2^32-1: any count these formats can hold. Throws InputError.
size_t parse_count(std::string_view word, const std::string& where);

/// What a header declares: `points` rows of named columns.
class PointTable {
 public:
  /// `count` values of a type that number_reader() knows, after the columns added before.
  void add(std::string_view name, proto::NumberType type, size_t count);
  /// Throws InputError, starting with `where`, unless x, y and z are there as single values.
  void check(const std::string& where) const;

  size_t points = 0;
  size_t row_bytes() const { return row_bytes_; }

  /// Binary, point after point: `points * row_bytes()` bytes at `rows`.
  PointCloud decode_rows(const char* rows, bool big_endian) const;
  /// Binary little-endian, column after column (PCD's compressed form), as many bytes.
  PointCloud decode_columns(const char* columns) const;
  /// Text, a line per point; blank lines do not count. Throws InputError with file:line.
  PointCloud parse_rows(TextCursor* text) const;

 private:
  struct Column {
    std::string name;
    proto::NumberType type;  // little-endian
    size_t count;
    size_t offset;  // in a row [bytes]
    size_t index;   // in a row [values]
  };
  const Column* find(std::string_view name) const;
  const Column* find_time() const;

  std::vector<Column> columns_;
  size_t row_bytes_ = 0, row_values_ = 0;
};

}  // namespace revisit::pipeline
