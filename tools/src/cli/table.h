#pragma once

#include <iosfwd>
#include <string>
#include <vector>

namespace revisit::cli {

/// A table of text: columns padded to their widest cell, numbers to the right.
class Table {
 public:
  explicit Table(std::vector<std::string> header);
  void row(std::vector<std::string> cells);
  /// Aligned text; cells are made printable().
  void print(std::ostream& out) const;
  /// RFC 4180 comma-separated values, header first; the exact bytes.
  void print_csv(std::ostream& out) const;

 private:
  std::vector<std::vector<std::string>> rows_;  // rows_[0] is the header
};

/// A number with `digits` decimals, or "" for NaN (not computed).
std::string number(double value, int digits);

}  // namespace revisit::cli
