#include "loops/loop_views.h"

#include <signal.h>

#include <algorithm>
#include <cstdlib>
#include <utility>

#include "cli/shell.h"
#include "cli/terminal.h"
#include "loops/loop_writer.h"
#include "loops/recording.h"
#include "report/report.h"
#include "revisit/base/error.h"
#include "revisit/base/files.h"

namespace revisit::cli {
namespace fs = std::filesystem;

LoopPage::LoopPage(fs::path file, const std::string& title, std::string command)
    : file_(std::move(file)), command_(std::move(command)) {
  need_report(file_, "move it, or give another --output");
  page_.add_loops()->set_title(title);
}

void LoopPage::add(const reports::LoopLine& line) {
  *page_.mutable_loops(0)->add_lines() = line;
  if (Clock::now() >= next_) write(true);
}

void LoopPage::write(bool reloads) {
  constexpr std::chrono::seconds kPause{3};
  constexpr int kShare = 20;  // of the time, at most, is for writing
  const Clock::time_point start = Clock::now();
  reports::Page page = page_;
  complete_page({.title = "Loops", .command = command_, .reloads = reloads}, &page);
  write_atomically(file_, [&](std::ostream& out) { out << html_page(page); });
  const Clock::time_point end = Clock::now();
  next_ = end + std::max<Clock::duration>(kPause, kShare * (end - start));
  if (opened_) return;
  opened_ = true;
  if (std::getenv("DISPLAY") == nullptr && std::getenv("WAYLAND_DISPLAY") == nullptr) return;
  // In the background, because it may last until the browser ends.
  const char* const open = "command -v xdg-open >/dev/null && { xdg-open \"$0\" & }";
  if (run_program({"sh", "-c", open, fs::absolute(file_).string()}, "dash") != 0)
    warn("xdg-open is not installed (Debian: apt install xdg-utils)");
}

RerunViewer::RerunViewer(const FeatureOptions& data) {
  Arguments words = {"-m", "revisit.show", "-"};
  if (data.data != "-") words.push_back(data.data.string());
  for (const std::string& option : reader_options(data)) words.push_back(option);
  ::signal(SIGPIPE, SIG_IGN);
  pipe_ = ::popen(shell_command(shell_word(python_interpreter()), words).c_str(),
                  "we");  // a browser must not keep the pipe open
  if (pipe_ == nullptr) throw Error("--rerun: cannot start a program");
}

RerunViewer::~RerunViewer() {
  if (pipe_ != nullptr) ::pclose(pipe_);
}

void RerunViewer::add(const reports::LoopLine& line) {
  if (std::fputs((json_of(line) + "\n").c_str(), pipe_) < 0 || std::fflush(pipe_) != 0) fail();
}

void RerunViewer::finish() {
  if (::pclose(std::exchange(pipe_, nullptr)) != 0) fail();
}

void RerunViewer::fail() {
  throw Error(
      "--rerun: `python3 -m revisit.show` has ended; it needs the Python package and rerun-sdk "
      "(pip install '.[rerun]'), or set REVISIT_PYTHON to an interpreter with them");
}

}  // namespace revisit::cli
