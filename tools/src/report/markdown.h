#pragma once

#include <iosfwd>
#include <string>

#include "reports.pb.h"

namespace revisit::cli {

/// Starts with kMarkdownMark.
std::string results_markdown(const reports::Page& page);
inline constexpr const char* kMarkdownMark =
    "# Results\n\nThe experiments of the paper (Sun, Liu, Ye, Yeung: Point-cloud-based place "
    "recognition using CNN feature extraction), made with\n\n";

void print_experiment(const reports::Experiment& experiment, std::ostream& out);

}  // namespace revisit::cli
