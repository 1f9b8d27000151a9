#include "progress.h"

#include <unistd.h>

#include <cstdio>

namespace revisit::cli {

Progress::Progress(std::string verb, std::string unit, bool enabled)
    : verb_(std::move(verb)), unit_(std::move(unit)), enabled_(enabled && isatty(STDERR_FILENO)) {}

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
  std::fprintf(stderr, "\r\033[K%s %lld/%lld [%lld%%]", verb_.c_str(), static_cast<long long>(done),
               static_cast<long long>(total),
               static_cast<long long>(total ? 100 * done / total : 100));
  if (rate > 0) {
    const auto left = static_cast<long long>(static_cast<double>(total - done) / rate + 0.5);
    std::fprintf(stderr, rate < 10 ? " %.1f %s/s" : " %.0f %s/s", rate, unit_.c_str());
    std::fprintf(stderr, " ETA %02lld:%02lld", left / 60, left % 60);
  }
  std::fflush(stderr);
}

}  // namespace revisit::cli
