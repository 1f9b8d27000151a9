#include <algorithm>
#include <cmath>
#include <numeric>
#include <sstream>

#include "cli/table.h"
#include "plots/plots.h"
#include "revisit/proto/error.h"

namespace revisit::cli {
namespace {

using pipeline::ScoreHistogram;

/// Shares, not counts: true matches are often so few that their counts would not be seen.
double percent(int64_t count, int64_t total) {
  return total ? 100.0 * static_cast<double>(count) / static_cast<double>(total) : 0;
}

ScoreHistogram histogram_of(const std::vector<pipeline::Verdict>& verdicts) {
  double low = 0, high = 1;
  if (!verdicts.empty()) {
    const auto by_score = [](const auto& a, const auto& b) { return a.score < b.score; };
    const auto [least, most] = std::minmax_element(verdicts.begin(), verdicts.end(), by_score);
    low = least->score;
    high = most->score > low ? most->score : low + 1e-3;
  }
  ScoreHistogram histogram{low, (high - low) / ScoreHistogram::kBins, {}, {}};
  for (const pipeline::Verdict& verdict : verdicts) {
    if (verdict.ignored) continue;
    const int bin = static_cast<int>((verdict.score - low) / histogram.width);
    ++(verdict.correct ? histogram.of_true
                       : histogram.of_false)[std::clamp(bin, 0, ScoreHistogram::kBins - 1)];
  }
  return histogram;
}

/// What the axes and the legend call the things counted.
struct Words {
  const char *score, *things, *thing;
};

PlotFiles draw_histogram(const std::filesystem::path& folder, const std::string& name,
                         const std::string& title, const ScoreHistogram& h, double threshold,
                         const Words& words) {
  const int64_t n_true = std::accumulate(h.of_true.begin(), h.of_true.end(), int64_t{0});
  const int64_t n_false = std::accumulate(h.of_false.begin(), h.of_false.end(), int64_t{0});
  std::ostringstream data, commands;
  data << "# bin_centre not_true true [% of each]; bins " << h.width << " wide\n";
  for (size_t bin = 0; bin < ScoreHistogram::kBins; ++bin)
    data << h.low + (static_cast<double>(bin) + 0.5) * h.width << " "
         << percent(h.of_false[bin], n_false) << " " << percent(h.of_true[bin], n_true) << "\n";
  const std::string source = quoted(name + ".dat");
  commands << "set title " << quoted(title) << "\n"
           << "set xlabel '" << words.score << "'\nset ylabel '" << words.things
           << " in the bin [% of each kind]'\n"
           << "set xrange [" << h.low - h.width << ":"
           << h.low + (ScoreHistogram::kBins + 1) * h.width << "]\nset yrange [0:*]\n"
           << "set boxwidth " << h.width << "\nset style fill transparent solid 0.55 noborder\n"
           << "set key top right Left reverse\n";
  if (!std::isnan(threshold))
    commands << "set arrow from first " << threshold << ", graph 0 to first " << threshold
             << ", graph 1 nohead linewidth 1.6 dashtype 2 linecolor rgb '#444444' front\n";
  commands << "plot " << source << " using 1:2 with boxes linecolor rgb '#d7191c' title "
           << quoted(str(words.thing, " not true (", n_false, ")")) << ", \\\n  " << source
           << " using 1:3 with boxes linecolor rgb '#1a9641' title "
           << quoted(str(words.thing, " true (", n_true, ")"));
  if (!std::isnan(threshold))
    commands << ", \\\n  NaN with lines dashtype 2 linewidth 1.6 linecolor rgb '#444444' title "
             << quoted("threshold " + number(threshold, 3));
  return draw(folder, name, data.str(), commands.str(), 700);
}

}  // namespace

PlotFiles plot_scores(const std::filesystem::path& folder, const std::string& name,
                      const std::string& title, const std::vector<pipeline::Verdict>& verdicts,
                      double threshold) {
  return draw_histogram(folder, name, title, histogram_of(verdicts), threshold,
                        {"Score of the best match", "Queries", "match"});
}

PlotFiles plot_pair_scores(const std::filesystem::path& folder, const std::string& name,
                           const std::string& title, const ScoreHistogram& histogram,
                           double threshold) {
  return draw_histogram(folder, name, title, histogram, threshold,
                        {"Similarity of the pair", "Pairs", "pair"});
}

}  // namespace revisit::cli
