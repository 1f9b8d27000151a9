#pragma once

#include <string>

#include "report/report_data.h"

namespace revisit::cli {

/// docs/RESULTS.md: figures and tables of the experiments, the command beside each number.
/// `figures` is the folder of the figures as the file sees it.
std::string results_markdown(const ReportData& data, const std::filesystem::path& figures);

}  // namespace revisit::cli
