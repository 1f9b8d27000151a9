#include "progress.h"

#include <sys/ioctl.h>
#include <unistd.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <string_view>

#include "cli/table.h"
#include "revisit/base/error.h"

namespace revisit::cli {

namespace {

size_t terminal_columns() {
  winsize size{};
  return ::ioctl(STDERR_FILENO, TIOCGWINSZ, &size) == 0 ? size.ws_col : 0;
}

}  // namespace

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

}  // namespace revisit::cli
