#include "io/file_content.h"

#include <fcntl.h>
#include <unistd.h>

#include <algorithm>
#include <charconv>
#include <cmath>

#include "revisit/base/error.h"

namespace revisit::pipeline {

namespace fs = std::filesystem;

constexpr std::string_view kBlanks = " \t";

void read_ahead(const fs::path& file) {
  const int descriptor = ::open(file.c_str(), O_RDONLY | O_CLOEXEC | O_NONBLOCK);
  if (descriptor < 0) return;
  ::posix_fadvise(descriptor, 0, 0, POSIX_FADV_WILLNEED);
  ::close(descriptor);
}

std::vector<std::string> read_lines(const fs::path& file) {
  const std::string content = read_content(file);
  std::string_view rest = content;
  if (rest.starts_with("\xEF\xBB\xBF")) rest.remove_prefix(3);
  std::vector<std::string> lines;
  while (!rest.empty()) {
    const size_t end = std::min(rest.find('\n'), rest.size());
    std::string_view line = rest.substr(0, end);
    rest.remove_prefix(std::min(end + 1, rest.size()));
    if (line.ends_with('\r')) line.remove_suffix(1);
    lines.emplace_back(line);
  }
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
  const char* const first = word.data() + (word.starts_with('+') ? 1 : 0);  // as printf's "%+e"
  const char* const last = word.data() + word.size();
  double value = 0;
  const auto [stop, error] = std::from_chars(first, last, value);
  if (error != std::errc() || stop != last || (!may_be_infinite && !std::isfinite(value)))
    throw InputError(str(where, ": expected a ", may_be_infinite ? "" : "finite ",
                         "number, found '", word.substr(0, 40), "'"));
  return value;
}

std::vector<double> parse_numbers(std::string_view text, const std::string& where) {
  std::vector<double> numbers;
  for (std::string_view word; !(word = take_word(&text)).empty();)
    numbers.push_back(parse_number(word, where, false));
  return numbers;
}

}  // namespace revisit::pipeline
