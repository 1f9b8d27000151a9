#pragma once

#include <filesystem>
#include <string>
#include <string_view>
#include <vector>

#include "revisit/base/files.h"

namespace revisit {

/// Ignores errors; the reader reports them.
void read_ahead(const std::filesystem::path& file);

class TextCursor {
 public:
  TextCursor(std::string_view text, std::string name) : rest_(text), name_(std::move(name)) {}
  /// Removes the line's end (LF or CRLF). Returns false at the end of the text.
  bool next(std::string_view* line);
  /// "file:line" of the last line
  std::string where() const;
  std::string_view rest() const { return rest_; }
  const std::string& name() const { return name_; }

 private:
  std::string_view rest_;
  std::string name_;
  size_t line_ = 0;
};

/// Reads the lines of a text file without their ends (LF or CRLF) and a byte order mark. Trailing
/// blank lines are dropped; lines()[i] is line i + 1 of the file. Throws as read_content() does.
std::vector<std::string> read_lines(const std::filesystem::path& file);

/// Removes the first blank-separated word from `text`; "" if there is none.
std::string_view take_word(std::string_view* text);

/// Throws InputError, starting with `where`.
double parse_number(std::string_view word, const std::string& where, bool may_be_infinite);

/// Numbers are blank-separated and finite. Throws InputError, starting with `where`.
std::vector<double> parse_numbers(std::string_view text, const std::string& where);

}  // namespace revisit
