#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "plots/gnuplot.h"
#include "revisit/pipeline/pairs.h"
#include "revisit/pipeline/precision_recall.h"

namespace revisit::cli {

/// One curve; its legend is "label (AP 0.873)".
struct PrCurve {
  std::string label;
  std::vector<pipeline::PrPoint> points;
  double average_precision = 0;  // NaN: nothing to find, the legend says so
};

/// Precision against recall, one line a curve. All functions here draw FOLDER/NAME.{dat,gp,png,svg}
/// and throw Error when these cannot be written; see PlotFiles::warning for a missing gnuplot.
///
///   const PlotFiles plot =
///       plot_precision_recall(folder, "pr_online", "KITTI 00", {{"conv3+pool5", curve, ap}});
///   if (!plot.warning.empty()) std::cerr << "revisit: " << plot.warning << "\n";
PlotFiles plot_precision_recall(const std::filesystem::path& folder, const std::string& name,
                                const std::string& title, const std::vector<PrCurve>& curves);

/// The drive from above (x to the right, z up, equal scales): its path, stored scans, queries, and
/// what became of them: `accepted` [queries] matches that are right green, wrong ones red, each
/// with a line to the match, missed ones orange.
PlotFiles plot_trajectory(const std::filesystem::path& folder, const std::string& name,
                          const std::string& title, const pipeline::Trajectory& trajectory,
                          const pipeline::Task& task, const std::vector<pipeline::Match>& matches,
                          const std::vector<pipeline::Verdict>& verdicts,
                          const std::vector<bool>& accepted);

/// Histograms of the scores of queries whose best match is true and not true, with the threshold
/// (NaN: none).
PlotFiles plot_scores(const std::filesystem::path& folder, const std::string& name,
                      const std::string& title, const std::vector<pipeline::Verdict>& verdicts,
                      double threshold);
/// The same of a task that decides on pairs.
PlotFiles plot_pair_scores(const std::filesystem::path& folder, const std::string& name,
                           const std::string& title, const pipeline::ScoreHistogram& histogram,
                           double threshold);

}  // namespace revisit::cli
