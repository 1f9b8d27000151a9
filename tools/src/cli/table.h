#pragma once

#include <iosfwd>
#include <string>
#include <vector>

namespace revisit::cli {

class Table {
 public:
  explicit Table(std::vector<std::string> header);
  void row(std::vector<std::string> cells);
  /// Pads columns, aligns numbers right, and makes cells printable().
  void print(std::ostream& out) const;
  /// RFC 4180 comma-separated values, header first; the exact bytes.
  void print_csv(std::ostream& out) const;

 private:
  std::vector<std::vector<std::string>> rows_;  // rows_[0] is the header
};

/// "" for NaN (not computed).
std::string number(double value, int digits);

/// `format`: of strftime().
std::string local_time(const char* format);

}  // namespace revisit::cli
