#pragma once

#include <filesystem>
#include <string>
#include <vector>

namespace revisit::cli {

/// A table of comma-separated values (RFC 4180) with a header, as Table::print_csv() writes it.
class CsvFile {
 public:
  /// Throws InputError with file:line for an unreadable file, a row of another width than the
  /// header, and an unclosed quote.
  explicit CsvFile(std::filesystem::path file);

  size_t rows() const { return rows_.size(); }
  /// The column called `name`. Throws InputError when there is none.
  size_t column(const std::string& name) const;
  const std::string& text(size_t row, size_t column) const { return rows_[row].cells[column]; }
  /// NaN for a blank cell. Throws InputError with file:line for what is no number.
  double number(size_t row, size_t column) const;
  /// Throws InputError with file:line for what is no whole number, a blank cell among it.
  int whole_number(size_t row, size_t column) const;

 private:
  struct Row {
    std::vector<std::string> cells;
    int line = 0;  // in the file, from 1
  };
  template <class Number>
  Number parsed(size_t row, size_t column, const char* expected) const;
  [[noreturn]] void fail(int line, const std::string& what) const;

  std::filesystem::path file_;
  std::vector<std::string> header_;
  std::vector<Row> rows_;
};

}  // namespace revisit::cli
