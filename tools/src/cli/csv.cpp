#include "cli/csv.h"

#include <algorithm>
#include <charconv>
#include <cmath>

#include "cli/text_file.h"
#include "revisit/proto/error.h"

namespace revisit::cli {

CsvFile::CsvFile(std::filesystem::path file) : file_(std::move(file)) {
  const std::string text = read_text_file(file_);

  int line = 1;
  Row row{{""}, line};
  bool quoted = false;
  const auto end_row = [&] {
    if (header_.empty()) {
      header_ = std::move(row.cells);
    } else {
      if (row.cells.size() != header_.size())
        fail(row.line, str("expected ", header_.size(), " columns, found ", row.cells.size()));
      rows_.push_back(std::move(row));
    }
    row = {{""}, line};
  };
  for (size_t i = 0; i < text.size(); ++i) {
    const char c = text[i];
    if (c == '\n') ++line;
    if (quoted) {
      if (c != '"')
        row.cells.back() += c;
      else if (i + 1 < text.size() && text[i + 1] == '"')
        row.cells.back() += text[++i];
      else
        quoted = false;
    } else if (c == '"') {
      quoted = true;
    } else if (c == ',') {
      row.cells.emplace_back();
    } else if (c == '\n') {
      end_row();
    } else if (c != '\r') {
      row.cells.back() += c;
    }
  }
  if (quoted) fail(row.line, "a quote is not closed");
  if (row.cells.size() > 1 || !row.cells[0].empty()) end_row();
  if (header_.empty()) fail(1, "expected a header, found an empty file");
}

size_t CsvFile::column(const std::string& name) const {
  const auto found = std::find(header_.begin(), header_.end(), name);
  if (found == header_.end()) fail(1, "no column '" + name + "'");
  return static_cast<size_t>(found - header_.begin());
}

template <class Number>
Number CsvFile::parsed(size_t row, size_t column, const char* expected) const {
  const std::string& cell = text(row, column);
  Number value = 0;
  const auto [end, error] = std::from_chars(cell.data(), cell.data() + cell.size(), value);
  if (error != std::errc() || end != cell.data() + cell.size())
    fail(rows_[row].line,
         str("column '", header_[column], "': expected ", expected, ", found '", cell, "'"));
  return value;
}

double CsvFile::number(size_t row, size_t column) const {
  return text(row, column).empty() ? std::nan("") : parsed<double>(row, column, "a number");
}

int CsvFile::whole_number(size_t row, size_t column) const {
  return parsed<int>(row, column, "a whole number");
}

void CsvFile::fail(int line, const std::string& what) const {
  throw InputError(str(file_.string(), ":", line, ": ", what));
}

}  // namespace revisit::cli
