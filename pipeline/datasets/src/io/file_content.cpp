#include "io/file_content.h"

#include <fcntl.h>
#include <unistd.h>

#include <algorithm>
#include <charconv>
#include <cmath>

#include "revisit/base/error.h"

namespace revisit {

namespace fs = std::filesystem;

constexpr std::string_view kBlanks = " \t";

void read_ahead(const fs::path& file) {
  const int descriptor = ::open(file.c_str(), O_RDONLY | O_CLOEXEC | O_NONBLOCK);
  if (descriptor < 0) return;
  ::posix_fadvise(descriptor, 0, 0, POSIX_FADV_WILLNEED);
  ::close(descriptor);
}

bool TextCursor::next(std::string_view* line) {
  if (rest_.empty()) return false;
  const size_t end = rest_.find('\n');
  *line = rest_.substr(0, end);
  rest_.remove_prefix(end == std::string_view::npos ? rest_.size() : end + 1);
  if (line->ends_with('\r')) line->remove_suffix(1);
  ++line_;
  return true;
}

std::string TextCursor::where() const {
  return str(name_, ":", line_);
}

std::vector<std::string> read_lines(const fs::path& file) {
  const std::string content = read_content(file);
  constexpr std::string_view kByteOrderMark = "\xEF\xBB\xBF";
  std::string_view line = content;
  if (line.starts_with(kByteOrderMark)) line.remove_prefix(kByteOrderMark.size());
  std::vector<std::string> lines;
  for (TextCursor text(line, file.string()); text.next(&line);) lines.emplace_back(line);
  while (!lines.empty() && lines.back().find_first_not_of(kBlanks) == std::string::npos)
    lines.pop_back();
  return lines;
}

std::string_view take_word(std::string_view* text) {
  const size_t begin = std::min(text->find_first_not_of(kBlanks), text->size());
  const std::string_view word =
      text->substr(begin, std::min(text->find_first_of(kBlanks, begin), text->size()) - begin);
  text->remove_prefix(begin + word.size());
  return word;
}

double parse_number(std::string_view word, const std::string& where, bool may_be_infinite) {
  const char* const first = word.data() + (word.starts_with('+') ? 1 : 0);  // as in printf's "%+e"
  const char* const last = word.data() + word.size();
  double value = 0;
  const auto [stop, error] = std::from_chars(first, last, value);
  if (error != std::errc() || stop != last || (!may_be_infinite && !std::isfinite(value)))
    throw InputError(where, ": expected a ", may_be_infinite ? "" : "finite ", "number, found '",
                     word.substr(0, 40), "'");
  return value;
}

std::vector<double> parse_numbers(std::string_view text, const std::string& where) {
  std::vector<double> numbers;
  for (std::string_view word; !(word = take_word(&text)).empty();)
    numbers.push_back(parse_number(word, where, false));
  return numbers;
}

}  // namespace revisit
