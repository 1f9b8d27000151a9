#include <algorithm>
#include <cmath>
#include <sstream>

#include "cli/table.h"
#include "plots/plots.h"

namespace revisit::cli {
namespace {

/// Where the curves are not: poor ones are at the bottom left, good ones pass at the top right.
const char* place_of_key(double lowest, double highest) {
  if (lowest >= 0.5) return "bottom left";
  return highest < 0.5 ? "top right" : "outside right top";
}

}  // namespace

PlotFiles plot_precision_recall(const std::filesystem::path& folder, const std::string& name,
                                const std::string& title, const std::vector<PrCurve>& curves) {
  std::ostringstream data, plot;
  data << "# recall precision threshold; one block a curve, highest threshold first\n";
  size_t drawn = 0;
  double lowest = 1, highest = 0;
  for (const PrCurve& curve : curves) {
    const bool empty = curve.points.empty() || std::isnan(curve.average_precision);
    const std::string legend =
        curve.label +
        (empty ? " (no true match to find)" : " (AP " + number(curve.average_precision, 3) + ")");
    plot << (drawn || &curve != &curves.front() ? ", \\\n  " : "plot ");
    if (empty) {
      plot << "NaN with lines linecolor rgb '#bbbbbb' title " << quoted(legend);
      continue;
    }
    lowest = std::min(lowest, curve.average_precision);
    highest = std::max(highest, curve.average_precision);
    data << "# " << legend << "\n";
    // The curve starts at recall 0 with the precision of the surest match.
    data << "0 " << curve.points.front().precision << " " << curve.points.front().threshold << "\n";
    for (const pipeline::PrPoint& point : curve.points)
      data << point.recall << " " << point.precision << " " << point.threshold << "\n";
    data << "\n\n";
    plot << quoted(name + ".dat") << " index " << drawn++ << " using 1:2 with lines title "
         << quoted(legend);
  }
  std::ostringstream commands;
  commands << "set title " << quoted(title) << "\n"
           << "set xlabel 'Recall (found / queries with a true match)'\n"
           << "set ylabel 'Precision (right / accepted)'\n"
           << "set xrange [0:1]\nset yrange [0:1.02]\nset xtics 0.1\nset ytics 0.1\n"
           << "set key Left reverse box linecolor rgb '#cccccc' opaque width 1 height 0.4 "
           << place_of_key(lowest, highest) << "\n"
           << (curves.empty() ? "plot NaN notitle" : plot.str());
  return draw(folder, name, data.str(), commands.str());
}

}  // namespace revisit::cli
