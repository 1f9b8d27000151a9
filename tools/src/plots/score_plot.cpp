#include <algorithm>
#include <cmath>
#include <sstream>

#include "cli/table.h"
#include "plots/plots.h"
#include "revisit/proto/error.h"

namespace revisit::cli {
namespace {

constexpr int kBins = 60;

/// Shares, not counts: true matches are often so few that their counts would not be seen.
double percent(int64_t count, int64_t total) {
  return total ? 100.0 * static_cast<double>(count) / static_cast<double>(total) : 0;
}

}  // namespace

PlotFiles plot_scores(const std::filesystem::path& folder, const std::string& name,
                      const std::string& title, const std::vector<pipeline::Verdict>& verdicts,
                      double threshold) {
  double low = 0, high = 1;
  if (!verdicts.empty()) {
    const auto by_score = [](const auto& a, const auto& b) { return a.score < b.score; };
    const auto [least, most] = std::minmax_element(verdicts.begin(), verdicts.end(), by_score);
    low = least->score;
    high = most->score > low ? most->score : low + 1e-3;
  }
  const double width = (high - low) / kBins;
  int64_t counts[kBins][2] = {}, totals[2] = {};  // not true, true
  for (const pipeline::Verdict& verdict : verdicts) {
    const int bin = std::clamp(static_cast<int>((verdict.score - low) / width), 0, kBins - 1);
    ++counts[bin][verdict.correct];
    ++totals[verdict.correct];
  }
  std::ostringstream data, commands;
  data << "# bin_centre not_true true [% of each]; bins " << width << " wide\n";
  for (int bin = 0; bin < kBins; ++bin)
    data << low + (bin + 0.5) * width << " " << percent(counts[bin][0], totals[0]) << " "
         << percent(counts[bin][1], totals[1]) << "\n";
  const std::string source = quoted(name + ".dat");
  commands
      << "set title " << quoted(title) << "\n"
      << "set xlabel 'Score of the best match'\nset ylabel 'Queries in the bin [% of each kind]'\n"
      << "set xrange [" << low - width << ":" << high + width << "]\nset yrange [0:*]\n"
      << "set boxwidth " << width << "\nset style fill transparent solid 0.55 noborder\n"
      << "set key top right Left reverse\n";
  if (!std::isnan(threshold))
    commands << "set arrow from first " << threshold << ", graph 0 to first " << threshold
             << ", graph 1 nohead linewidth 1.6 dashtype 2 linecolor rgb '#444444' front\n";
  commands << "plot " << source << " using 1:2 with boxes linecolor rgb '#d7191c' title "
           << quoted(str("match not true (", totals[0], ")")) << ", \\\n  " << source
           << " using 1:3 with boxes linecolor rgb '#1a9641' title "
           << quoted(str("match true (", totals[1], ")"));
  if (!std::isnan(threshold))
    commands << ", \\\n  NaN with lines dashtype 2 linewidth 1.6 linecolor rgb '#444444' title "
             << quoted("threshold " + number(threshold, 3));
  return draw(folder, name, data.str(), commands.str(), 700);
}

}  // namespace revisit::cli
