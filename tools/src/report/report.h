#pragma once

#include <filesystem>
#include <map>
#include <string>
#include <vector>

#include "cli/terminal.h"
#include "reports.pb.h"

namespace revisit::cli {

struct PageOptions {
  std::string title = "Place recognition", command;
  int queries = 3;       // per kind in the query browser
  double image_mb = 12;  // maximum size of range images
  bool reloads = false;
  bool over_sequences = false;  // in the summary
};

/// Reads run.json and experiment.json with its runs in and below folders, (growing) files of
/// `revisit loops --format jsonl`, and matches in .csv files. A run of several experiments is read
/// once. Throws InputError for a folder without any of these, and for a file that revisit did not
/// write.
reports::Page read_runs(const std::vector<std::filesystem::path>& folders);

/// One row per task, settings and sequence, or with `over_sequences` per task and settings. Of runs
/// with the same settings on the same data the last counts. Without tasks of perturbed queries.
reports::Summary summarize_runs(const google::protobuf::RepeatedPtrField<reports::Run>& runs,
                                bool over_sequences = false);
Table summary_table(const reports::Summary& summary);

/// Adds titles and queries with range images, and removes data that the page does not show.
void complete_page(const PageOptions& options, reports::Page* page);

std::string html_page(const reports::Page& page);

/// Throws UsageError with the advice if a file exists and is no page of html_page().
void need_report(const std::filesystem::path& file, const std::string& advice);

/// Writes the page of `folders` atomically and warns of missing data. Throws Error, and what
/// read_runs() throws.
reports::Page write_report(const std::vector<std::filesystem::path>& folders,
                           const std::filesystem::path& file, const PageOptions& options);

std::string profile_page(const reports::NetReport& report, const std::string& command);

/// Reduced range images as data URIs, with a limit on their total size.
class RangeImages {
 public:
  explicit RangeImages(size_t most_bytes) : most_bytes_(most_bytes) {}

  /// Key of a scan's picture in images(), or "". `turned`: alignment case 2.
  std::string add(const std::string& scan_file, const reports::RunInfo& info, bool turned);

  const std::map<std::string, std::string>& images() const { return images_; }
  /// Reason for missing pictures, or "".
  const std::string& warning() const { return warning_; }

 private:
  size_t most_bytes_, bytes_ = 0;
  std::map<std::string, std::string> images_;  // "case1 4000x112 /data/000123.bin" -> data URI
  std::string warning_;
};

}  // namespace revisit::cli
