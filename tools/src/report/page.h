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

/// Adds to a page with runs and experiments what else it shows: titles, queries with their range
/// images, the methods of the paper; and takes away what it does not show.
void complete_page(const PageOptions& options, reports::Page* page);

/// The page as one file that needs nothing else, also offline.
std::string html_page(const reports::Page& page);
/// In each such page, of earlier versions, too.
inline constexpr const char* kHtmlMark = "<main id=\"report\"></main>";

/// A file that is there may be replaced when it is an earlier report, which has `mark` in it.
/// Throws UsageError with the advice for another one, which may be somebody's work.
void need_report(const std::filesystem::path& file, const std::string& mark,
                 const std::string& advice);

/// Makes the page of the runs and experiments in `folders` and writes it to `file`, whole or not at
/// all; says on stderr what could not be shown. Throws what read_runs() does, and Error.
reports::Page write_report(const std::vector<std::filesystem::path>& folders,
                           const std::filesystem::path& file, const PageOptions& options);

}  // namespace revisit::cli
