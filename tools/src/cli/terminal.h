#pragma once

#include <chrono>
#include <cstdint>
#include <functional>
#include <iosfwd>
#include <memory>
#include <ostream>
#include <string>
#include <string_view>
#include <vector>

namespace revisit::cli {

/// Prints "note: ..." or "warning: ..." to standard error.
void note(const std::string& message);
void warn(const std::string& message);
void warn_skipped(const std::string& why);

/// Escapes control characters and bytes outside of UTF-8 for a terminal, as \x1b.
std::string printable(std::string_view text);

/// Replaces bytes outside of UTF-8 by U+FFFD.
std::string utf8(std::string_view text);

/// Makes all output of a stream printable during its lifetime, but for line ends and tabs. For
/// messages and terminals; files and pipes get the exact bytes.
class PrintableStream {
 public:
  explicit PrintableStream(std::ostream& stream);
  ~PrintableStream();
  PrintableStream(const PrintableStream&) = delete;
  PrintableStream& operator=(const PrintableStream&) = delete;

 private:
  class Buffer;
  std::ostream& stream_;
  std::unique_ptr<Buffer> buffer_;
  std::streambuf* before_;
};

/// Text that draws as much of `line` as fits over `before` characters, on a terminal of `columns`
/// (0: unknown). A dumb terminal gets blanks over the rest, because it cannot clear a line.
std::string redrawn(const std::string& line, size_t before, size_t columns, bool dumb);

/// Progress line on standard error, only if that is a terminal and `enabled`:
/// `describing 1234/4541 [27%] 81 scans/s ETA 00:41`. Redrawn at most ten times a second.
class Progress {
 public:
  Progress(std::string verb, std::string unit, bool enabled = true);
  ~Progress();  // ends the line
  Progress(const Progress&) = delete;
  Progress& operator=(const Progress&) = delete;

  void update(int64_t done, int64_t total);
  std::function<void(int64_t done, int64_t total)> callback() {
    return [this](int64_t done, int64_t total) { update(done, total); };
  }

 private:
  using Clock = std::chrono::steady_clock;
  std::string verb_, unit_;
  bool enabled_;
  bool drawn_ = false, dumb_ = false;
  size_t width_ = 0;  // of the drawn line
  Clock::time_point start_ = Clock::now(), last_{};
  int64_t first_done_ = -1;  // excluded from the rate: work of an earlier run
};

/// Handles SIGINT and SIGTERM: the first of either stops the work after its current unit, the
/// second at once.
void watch_for_interrupt();

bool interrupted();

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

/// "" for NaN (not computed); never "-0.00".
std::string number(double value, int digits);

/// `format`: of strftime().
std::string local_time(const char* format);

}  // namespace revisit::cli
