#pragma once

#include <filesystem>
#include <string>
#include <string_view>
#include <vector>

#include "revisit/base/file_content.h"

namespace revisit::pipeline {

/// Asks the system to have the file in memory soon. Errors are left to the reader.
void read_ahead(const std::filesystem::path& file);

/// A file in memory, read as text line by line (the header, or all of it), with the line's number.
class TextCursor {
 public:
  TextCursor(std::string_view text, std::string name) : rest_(text), name_(std::move(name)) {}
  /// The next line without its end (LF or CRLF), or false at the end of the text.
  bool next(std::string_view* line);
  /// "file:line" of the line next() gave last.
  std::string where() const;
  std::string_view rest() const { return rest_; }
  const std::string& name() const { return name_; }

 private:
  std::string_view rest_;
  std::string name_;
  size_t line_ = 0;
};

/// The lines of a text file without their ends (LF or CRLF) and a byte order mark; trailing blank
/// lines are dropped, so lines()[i] is line i + 1 of the file. Throws as read_content() does.
std::vector<std::string> read_lines(const std::filesystem::path& file);

/// Takes the first blank-separated word off `text`; "" when there is none.
std::string_view take_word(std::string_view* text);

/// A finite number, or any if `may_be_infinite`; else throws InputError, starting with `where`.
double parse_number(std::string_view word, const std::string& where, bool may_be_infinite);

/// Blank-separated finite numbers. Throws InputError, starting with `where`.
std::vector<double> parse_numbers(std::string_view text, const std::string& where);

}  // namespace revisit::pipeline
