#pragma once

#include <cstdint>
#include <filesystem>
#include <fstream>
#include <string>
#include <string_view>
#include <vector>

namespace revisit::pipeline {

/// A regular file opened for reading, and its size. Throws InputError for what cannot be opened or
/// is no regular file (a folder; a pipe, which could block for ever).
struct OpenFile {
  explicit OpenFile(const std::filesystem::path& file);
  /// Reads all `size` bytes. Throws InputError when there are fewer by now.
  void read(char* to);

  std::string name;
  std::ifstream stream;
  uint64_t size = 0;  // [bytes]
};

/// Asks the system to have the file in memory soon, without waiting for it. What cannot be read is
/// left to the reader to report.
void read_ahead(const std::filesystem::path& file);

/// The whole file. Throws InputError as OpenFile does.
std::string read_content(const std::filesystem::path& file);

/// The lines of a text file without their ends (LF or CRLF) and a byte order mark; trailing blank
/// lines are dropped, so lines()[i] is line i + 1 of the file. Throws InputError as OpenFile does.
std::vector<std::string> read_lines(const std::filesystem::path& file);

/// The finite numbers in `text`, separated by blanks. Throws InputError, starting with `where`, for
/// anything that is no finite number.
std::vector<double> parse_numbers(std::string_view text, const std::string& where);

}  // namespace revisit::pipeline
