#pragma once

#include "report/report_data.h"

namespace revisit::cli {

struct PageOptions {
  std::filesystem::path files;  // folder of the figures
  std::string title, command;
  int queries = 3;       // of each kind in the query browser
  double image_mb = 12;  // of range images in the page
  bool no_plots = false;
  bool static_figures = false;  // embed drawn figures: there is no plotting library
};

/// Everything the page shows; writes the figures and pictures to `options.files`. Throws Error when
/// they cannot be written.
reports::Page make_page(const ReportData& data, const PageOptions& options);

}  // namespace revisit::cli
