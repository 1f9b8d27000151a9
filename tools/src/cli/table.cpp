#include "table.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <ctime>
#include <iomanip>
#include <iostream>
#include <ostream>
#include <sstream>

#include "cli/terminal.h"
#include "revisit/base/error.h"

namespace revisit::cli {

namespace {

bool looks_numeric(const std::string& cell) {
  return !cell.empty() && cell.find_first_not_of("0123456789.+-eE%x") == std::string::npos;
}

}  // namespace

Table::Table(std::vector<std::string> header) : rows_{std::move(header)} {}

void Table::row(std::vector<std::string> cells) {
  cells.resize(rows_[0].size());
  rows_.push_back(std::move(cells));
}

void Table::print(std::ostream& out) const {
  struct Column {
    size_t width = 0;
    bool numeric = true;
  };
  std::vector<Column> columns(rows_[0].size(), {0, rows_.size() > 1});
  for (size_t r = 0; r < rows_.size(); ++r) {
    for (size_t c = 0; c < columns.size(); ++c) {
      const std::string& cell = rows_[r][c];
      columns[c].width = std::max(columns[c].width, printable(cell).size());
      columns[c].numeric &= r == 0 || cell.empty() || looks_numeric(cell);
    }
  }
  for (const auto& row : rows_) {
    std::string line;
    for (size_t c = 0; c < columns.size(); ++c) {
      const std::string cell = printable(row[c]);
      const std::string padding(columns[c].width - cell.size(), ' ');
      line += (c ? "  " : "") + (columns[c].numeric ? padding + cell : cell + padding);
    }
    line.erase(line.find_last_not_of(' ') + 1);
    out << line << "\n";
  }
}

void Table::print_csv(std::ostream& out) const {
  for (const auto& row : rows_) {
    for (size_t c = 0; c < row.size(); ++c) {
      if (c) out << ",";
      if (row[c].find_first_of(",\"\r\n") == std::string::npos) {
        out << row[c];
        continue;
      }
      out << '"';
      for (const char ch : row[c]) out << (ch == '"' ? "\"\"" : std::string(1, ch));
      out << '"';
    }
    out << "\n";
  }
}

std::string number(double value, int digits) {
  if (std::isnan(value)) return "";
  char text[64];
  std::snprintf(text, sizeof text, "%.*f", digits, value);
  return text;
}

std::string local_time(const char* format) {
  const std::time_t now = std::time(nullptr);
  std::tm parts{};
  localtime_r(&now, &parts);
  std::ostringstream text;
  text << std::put_time(&parts, format);
  return text.str();
}

}  // namespace revisit::cli
