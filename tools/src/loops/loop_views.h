#pragma once

#include <reports.pb.h>

#include <chrono>
#include <cstdio>
#include <filesystem>
#include <string>

#include "eval/feature_options.h"

namespace revisit::cli {

/// HTML page of loops that grows: rewritten every few seconds, opened in a browser if there is a
/// display.
class LoopPage {
 public:
  /// Throws UsageError if `file` exists and is no page.
  LoopPage(std::filesystem::path file, const std::string& title, std::string command);
  void add(const reports::LoopLine& line);
  /// Writes the page that stays.
  void finish() { write(false); }

 private:
  using Clock = std::chrono::steady_clock;
  void write(bool reloads);

  std::filesystem::path file_;
  std::string command_;
  reports::Page page_;
  Clock::time_point next_ = Clock::now();
  bool opened_ = false;
};

/// Rerun's viewer, which `python3 -m revisit.show` feeds with lines and the points of `data`.
class RerunViewer {
 public:
  explicit RerunViewer(const FeatureOptions& data);
  ~RerunViewer();
  RerunViewer(const RerunViewer&) = delete;
  RerunViewer& operator=(const RerunViewer&) = delete;
  /// Throws Error if the viewer has ended.
  void add(const reports::LoopLine& line);
  /// Waits for the viewer. Throws likewise if it has failed.
  void finish();

 private:
  [[noreturn]] static void fail();
  FILE* pipe_;
};

}  // namespace revisit::cli
