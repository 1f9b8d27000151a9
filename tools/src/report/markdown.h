#pragma once

#include <iosfwd>
#include <string>

#include "reports.pb.h"

namespace revisit::cli {

/// Tables of the page's experiments with the command of each row, after kMarkdownMark.
std::string results_markdown(const reports::Page& page);
inline constexpr const char* kMarkdownMark =
    "# Results\n\nThe experiments of the paper (Sun, Liu, Ye, Yeung: Point-cloud-based place "
    "recognition using CNN feature extraction), made with\n\n";

/// Prints the metrics of an experiment, and the reasons for its missing runs.
void print_experiment(const reports::Experiment& experiment, std::ostream& out);

}  // namespace revisit::cli
