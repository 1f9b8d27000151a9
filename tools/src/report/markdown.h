#pragma once

#include <string>

#include "report/report_data.h"

namespace revisit::cli {

/// docs/RESULTS.md: figures and tables of the experiments, the command beside each number.
/// `figures` is the folder of the figures as the file sees it.
/// Begins with kMarkdownMark.
std::string results_markdown(const ReportData& data, const std::filesystem::path& figures);
inline constexpr const char* kMarkdownMark =
    "# Results\n\nThe experiments of the paper (Sun, Liu, Ye, Yeung: Point-cloud-based place "
    "recognition using CNN feature extraction), made with\n\n";

}  // namespace revisit::cli
