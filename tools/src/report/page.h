#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "reports.pb.h"

namespace revisit::cli {

struct PageOptions {
  std::string title = "Place recognition", command;
  int queries = 3;       // of each kind in the query browser
  double image_mb = 12;  // of range images in the page
  bool reloads = false;  // the page is made again before long, and shows it
};

/// Adds titles and queries with their range images, and removes what the page does not show.
void complete_page(const PageOptions& options, reports::Page* page);

/// The page as one file that needs nothing else, also offline.
std::string html_page(const reports::Page& page);
/// In each such page, of earlier versions, too.
inline constexpr const char* kHtmlMark = "<main id=\"report\"></main>";

/// Throws UsageError with the advice for a file without `mark`, which may be somebody's work.
void need_report(const std::filesystem::path& file, const std::string& mark,
                 const std::string& advice);

/// Writes the page of `folders` atomically; warns of gaps. Throws Error and as read_runs().
reports::Page write_report(const std::vector<std::filesystem::path>& folders,
                           const std::filesystem::path& file, const PageOptions& options);

}  // namespace revisit::cli
