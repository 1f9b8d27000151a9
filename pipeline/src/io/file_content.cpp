#include "io/file_content.h"

#include <fcntl.h>
#include <unistd.h>

#include <cerrno>
#include <charconv>
#include <cmath>
#include <cstring>

#include "revisit/proto/error.h"

namespace revisit::pipeline {

namespace fs = std::filesystem;

OpenFile::OpenFile(const fs::path& file) : name(file.string()) {
  std::error_code error;
  const fs::file_status status = fs::status(file, error);
  if (!fs::exists(status)) throw InputError(str(file.string(), ": ", error.message()));
  if (!fs::is_regular_file(status)) throw InputError(file.string() + ": not a regular file");
  size = fs::file_size(file, error);
  errno = 0;
  stream.open(file, std::ios::binary);
  if (error || !stream)
    throw InputError(str(file.string(), ": cannot open: ",
                         error ? error.message() : std::string(std::strerror(errno))));
}

void OpenFile::read(char* to) {
  stream.read(to, static_cast<std::streamsize>(size));
  if (static_cast<uint64_t>(stream.gcount()) != size)
    throw InputError(str(name, ": expected ", size, " bytes, could read ", stream.gcount()));
}

void read_ahead(const fs::path& file) {
  const int descriptor = ::open(file.c_str(), O_RDONLY | O_CLOEXEC | O_NONBLOCK);
  if (descriptor < 0) return;
  ::posix_fadvise(descriptor, 0, 0, POSIX_FADV_WILLNEED);
  ::close(descriptor);
}

std::string read_content(const fs::path& file) {
  OpenFile in(file);
  std::string content(in.size, '\0');
  in.read(content.data());
  return content;
}

std::vector<std::string> read_lines(const fs::path& file) {
  OpenFile in(file);
  std::vector<std::string> lines;
  for (std::string line; std::getline(in.stream, line);) {
    if (!line.empty() && line.back() == '\r') line.pop_back();
    if (lines.empty() && line.starts_with("\xEF\xBB\xBF")) line.erase(0, 3);
    lines.push_back(std::move(line));
  }
  if (in.stream.bad()) throw InputError(file.string() + ": cannot read");
  while (!lines.empty() && lines.back().find_first_not_of(" \t") == std::string::npos)
    lines.pop_back();
  return lines;
}

std::vector<double> parse_numbers(std::string_view text, const std::string& where) {
  constexpr std::string_view kBlanks = " \t";
  std::vector<double> numbers;
  for (size_t begin; (begin = text.find_first_not_of(kBlanks)) != std::string_view::npos;) {
    text.remove_prefix(begin);
    const std::string_view token = text.substr(0, text.find_first_of(kBlanks));
    text.remove_prefix(token.size());
    const char* const first = token.data() + (token.front() == '+' ? 1 : 0);  // as printf's "%+e"
    const char* const last = token.data() + token.size();
    double value = 0;
    const auto [stop, error] = std::from_chars(first, last, value);
    if (error != std::errc() || stop != last || !std::isfinite(value))
      throw InputError(str(where, ": expected a finite number, found '", token.substr(0, 40), "'"));
    numbers.push_back(value);
  }
  return numbers;
}

}  // namespace revisit::pipeline
