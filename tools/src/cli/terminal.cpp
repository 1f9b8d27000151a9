#include "terminal.h"

#include <signal.h>
#include <sys/ioctl.h>
#include <unistd.h>

#include <algorithm>
#include <cmath>
#include <csignal>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <ctime>
#include <iomanip>
#include <iostream>
#include <ostream>
#include <sstream>
#include <streambuf>
#include <string_view>

#include "revisit/base/error.h"

namespace revisit::cli {
namespace {

bool looks_numeric(const std::string& cell) {
  return !cell.empty() && cell.find_first_not_of("0123456789.+-eE%x") == std::string::npos;
}

/// Bytes of the UTF-8 character that starts with `first`; 0 if none does.
size_t length_of(unsigned char first) {
  if (first < 0x80) return 1;
  if (first >= 0xc2 && first < 0xe0) return 2;
  if (first >= 0xe0 && first < 0xf0) return 3;
  if (first >= 0xf0 && first < 0xf5) return 4;
  return 0;
}

bool continues(char c) {
  return (static_cast<unsigned char>(c) & 0xc0) == 0x80;
}

/// 0 if `text` does not start with a valid UTF-8 character.
size_t length_of_first(std::string_view text) {
  const auto first = static_cast<unsigned char>(text[0]);
  const size_t length = length_of(first);
  if (length == 0 || length > text.size()) return 0;
  if (!std::all_of(text.begin() + 1, text.begin() + static_cast<std::ptrdiff_t>(length), continues))
    return 0;
  if (length < 3) return length;
  // Overlong, half a UTF-16 pair, or beyond U+10FFFF.
  const auto second = static_cast<unsigned char>(text[1]);
  const bool none = (first == 0xe0 && second < 0xa0) || (first == 0xed && second >= 0xa0) ||
                    (first == 0xf0 && second < 0x90) || (first == 0xf4 && second >= 0x90);
  return none ? 0 : length;
}

/// 0 for control characters: those below the blank, DEL, and U+0080 to U+009F.
size_t shown(std::string_view text) {
  const auto first = static_cast<unsigned char>(text[0]);
  if (first < ' ' || first == 0x7f) return 0;
  const size_t length = length_of_first(text);
  return first == 0xc2 && length > 0 && static_cast<unsigned char>(text[1]) < 0xa0 ? 0 : length;
}

std::string escaped(char c) {
  constexpr const char* kDigits = "0123456789abcdef";
  const auto byte = static_cast<unsigned char>(c);
  return {'\\', 'x', kDigits[byte >> 4], kDigits[byte & 15]};
}

std::string printable_but(std::string_view text, std::string_view kept) {
  std::string result;
  while (!text.empty()) {
    const size_t length = kept.find(text[0]) != std::string_view::npos ? 1 : shown(text);
    result += length ? std::string(text.substr(0, length)) : escaped(text[0]);
    text.remove_prefix(std::max<size_t>(length, 1));
  }
  return result;
}

size_t terminal_columns() {
  winsize size{};
  return ::ioctl(STDERR_FILENO, TIOCGWINSZ, &size) == 0 ? size.ws_col : 0;
}

volatile std::sig_atomic_t g_interrupted = 0;

void on_signal(int) {
  g_interrupted = 1;
  std::signal(SIGINT, SIG_DFL);
  std::signal(SIGTERM, SIG_DFL);
}

}  // namespace

void note(const std::string& message) {
  std::cerr << "note: " << message << "\n";
}

void warn(const std::string& message) {
  std::cerr << "warning: " << message << "\n";
}

void warn_skipped(const std::string& why) {
  warn(why + "; the scan is skipped");
}

std::string printable(std::string_view text) {
  return printable_but(text, "");
}

std::string utf8(std::string_view text) {
  std::string result;
  while (!text.empty()) {
    const size_t length = length_of_first(text);
    result += length > 0 ? text.substr(0, length) : std::string_view("\uFFFD");
    text.remove_prefix(std::max<size_t>(length, 1));
  }
  return result;
}

class PrintableStream::Buffer : public std::streambuf {
 public:
  explicit Buffer(std::streambuf* next) : next_(next) {}
  ~Buffer() override { write(""); }
  Buffer(const Buffer&) = delete;
  Buffer& operator=(const Buffer&) = delete;

 protected:
  int_type overflow(int_type c) override {
    if (traits_type::eq_int_type(c, traits_type::eof())) return traits_type::not_eof(c);
    const char byte = traits_type::to_char_type(c);
    return xsputn(&byte, 1) == 1 ? c : traits_type::eof();
  }
  std::streamsize xsputn(const char* text, std::streamsize size) override {
    started_.append(text, static_cast<size_t>(size));
    // The last character may be incomplete, because its bytes may arrive one by one.
    size_t tail = started_.size();
    while (tail > 0 && started_.size() - tail < 3 && continues(started_[tail - 1])) --tail;
    if (tail > 0) --tail;
    const bool whole =
        started_.size() - tail >= length_of(static_cast<unsigned char>(started_[tail]));
    std::string rest = whole ? "" : started_.substr(tail);
    if (!whole) started_.resize(tail);
    return write(std::move(rest)) ? size : 0;
  }
  int sync() override { return next_->pubsync(); }

 private:
  bool write(std::string rest) {
    const std::string text = printable_but(started_, "\n\t");
    started_ = std::move(rest);
    const auto size = static_cast<std::streamsize>(text.size());
    return next_->sputn(text.data(), size) == size;
  }

  std::streambuf* next_;
  std::string started_;
};

PrintableStream::PrintableStream(std::ostream& stream)
    : stream_(stream),
      buffer_(std::make_unique<Buffer>(stream.rdbuf())),
      before_(stream.rdbuf(buffer_.get())) {}

PrintableStream::~PrintableStream() {
  stream_.rdbuf(before_);
}

std::string redrawn(const std::string& line, size_t before, size_t columns, bool dumb) {
  // The last column stays free, because some terminals wrap after it.
  const std::string shown = columns > 1 ? line.substr(0, columns - 1) : line;
  if (!dumb) return "\r\033[K" + shown;
  return "\r" + shown + std::string(std::max(before, shown.size()) - shown.size(), ' ');
}

Progress::Progress(std::string verb, std::string unit, bool enabled)
    : verb_(std::move(verb)), unit_(std::move(unit)), enabled_(enabled && isatty(STDERR_FILENO)) {
  const char* terminal = std::getenv("TERM");
  dumb_ = !terminal || std::string_view(terminal) == "dumb";
}

Progress::~Progress() {
  if (drawn_) std::fputc('\n', stderr);
}

void Progress::update(int64_t done, int64_t total) {
  if (!enabled_) return;
  const Clock::time_point now = Clock::now();
  if (first_done_ < 0) first_done_ = done;
  if (drawn_ && done < total && now - last_ < std::chrono::milliseconds(100)) return;
  last_ = now;
  drawn_ = true;
  const double seconds = std::chrono::duration<double>(now - start_).count();
  const double rate = seconds > 0 ? static_cast<double>(done - first_done_) / seconds : 0;
  std::string line =
      str(verb_, " ", done, "/", total, " [", total ? 100 * done / total : 100, "%]");
  if (rate > 0) {
    const auto left = std::llround(static_cast<double>(total - done) / rate);
    char text[64];
    std::snprintf(text, sizeof text, " ETA %02lld:%02lld", left / 60, left % 60);
    line += str(" ", number(rate, rate < 10 ? 1 : 0), " ", unit_, "/s", text);
  }
  const size_t columns = terminal_columns();
  std::fputs(redrawn(line, width_, columns, dumb_).c_str(), stderr);
  width_ = columns > 1 ? std::min(line.size(), columns - 1) : line.size();
  std::fflush(stderr);
}

void watch_for_interrupt() {
  struct sigaction action {};
  action.sa_handler = on_signal;
  sigaction(SIGINT, &action, nullptr);
  sigaction(SIGTERM, &action, nullptr);
}

bool interrupted() {
  return g_interrupted != 0;
}

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
  const bool is_negative_zero =
      text[0] == '-' && std::strpbrk(text, "123456789i") == nullptr;  // i: -inf
  return text + (is_negative_zero ? 1 : 0);
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
