#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "reports.pb.h"

namespace revisit::cli {

struct PageOptions {
  std::string title = "Place recognition", command;
  int queries = 3;       // per kind in the query browser
  double image_mb = 12;  // maximum size of range images
  bool reloads = false;
};

/// Adds titles and queries with range images, and removes data that the page does not show.
void complete_page(const PageOptions& options, reports::Page* page);

std::string html_page(const reports::Page& page);
/// Part of every such page, also of earlier versions.
inline constexpr const char* kHtmlMark = "<main id=\"report\"></main>";

/// Throws UsageError with the advice if a file exists without `mark`, because it is no report.
void need_report(const std::filesystem::path& file, const std::string& mark,
                 const std::string& advice);

/// Writes the page of `folders` atomically and warns of missing data. Throws Error, and what
/// read_runs() throws.
reports::Page write_report(const std::vector<std::filesystem::path>& folders,
                           const std::filesystem::path& file, const PageOptions& options);

}  // namespace revisit::cli
