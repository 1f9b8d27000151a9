#include <algorithm>
#include <array>
#include <sstream>

#include "plots/plots.h"
#include "revisit/proto/error.h"

namespace revisit::cli {
namespace {

/// One layer of the map, drawn over those before it.
struct Layer {
  const char* legend;
  const char* style;
  bool with_lines;          // to the match
  std::ostringstream rows;  // x z [m], and those of the match
  int64_t count = 0;
};

}  // namespace

PlotFiles plot_trajectory(const std::filesystem::path& folder, const std::string& name,
                          const std::string& title, const pipeline::Trajectory& trajectory,
                          const pipeline::Task& task, const std::vector<pipeline::Match>& matches,
                          const std::vector<pipeline::Verdict>& verdicts, double threshold) {
  if (trajectory.positions.empty())
    throw UsageError("the map of a drive needs poses; this data set has none");
  if (matches.size() != verdicts.size())
    throw Error(
        str(matches.size(), " matches and ", verdicts.size(), " verdicts do not belong together"));
  Layer layers[] = {
      {"queries", "points pointtype 7 pointsize 0.45 linecolor rgb '#b8b8b8'", false, {}},
      {"stored", "points pointtype 7 pointsize 0.45 linecolor rgb '#3b76b5'", false, {}},
      {"missed", "points pointtype 7 pointsize 0.75 linecolor rgb '#f39c12'", false, {}},
      {"right", "points pointtype 7 pointsize 0.75 linecolor rgb '#1a9641'", true, {}},
      {"wrong", "points pointtype 7 pointsize 0.85 linecolor rgb '#d7191c'", true, {}},
  };
  auto& [queries, stored, missed, right, wrong] = layers;
  const auto add = [&](Layer& layer, int64_t scan, int64_t match) {
    const Eigen::Vector3d& a = trajectory.positions.at(scan);
    const Eigen::Vector3d& b = trajectory.positions.at(match);
    layer.rows << a.x() << " " << a.z() << " " << b.x() << " " << b.z() << "\n";
    ++layer.count;
  };
  // Where every scan is both (online), the path is drawn once, as queries.
  const bool all_stored = task.stored.size() == trajectory.frames.size();
  for (const int64_t scan : task.stored) add(all_stored ? queries : stored, scan, scan);
  if (all_stored) queries.legend = "drive (queries and stored)";
  for (size_t i = 0; i < matches.size(); ++i) {
    const bool accepted = verdicts[i].score >= threshold;
    if (!all_stored) add(queries, matches[i].query, matches[i].query);
    if (accepted && !matches[i].ranks.empty())
      add(verdicts[i].correct ? right : wrong, matches[i].query, matches[i].ranks[0]);
    else if (verdicts[i].positive)
      add(missed, matches[i].query, matches[i].query);
  }

  std::ostringstream data, plot;
  data << "# x z match_x match_z [m]; blocks: queries, stored, missed, right, wrong\n";
  int block = 0;
  for (Layer& layer : layers) {
    if (layer.count == 0) continue;
    data << layer.rows.str() << "\n\n";
    const std::string source = str(quoted(name + ".dat"), " index ", block);
    if (layer.with_lines)
      plot << (block ? ", \\\n  " : "plot ") << source
           << " using 1:2:($3-$1):($4-$2) with vectors nohead linewidth 1 linecolor rgb "
           << (&layer == &right ? "'#801a9641'" : "'#60d7191c'") << " notitle, \\\n  " << source;
    else
      plot << (block ? ", \\\n  " : "plot ") << source;
    plot << " using 1:2 with " << layer.style << " notitle";
    // The legend's own sample: the small dots of the map would not be readable there.
    plot
        << ", \\\n  NaN with "
        << std::string(layer.style).replace(std::string(layer.style).find("size 0."), 9, "size 1.4")
        << " title " << quoted(str(layer.legend, " (", layer.count, ")"));
    ++block;
  }
  std::ostringstream commands;
  commands << "set title " << quoted(title) << "\n"
           << "set xlabel 'x, right [m]'\nset ylabel 'z, forward [m]'\n"
           << "set size ratio -1\nset offsets graph 0.03, graph 0.03, graph 0.03, graph 0.03\n"
           << "set key outside right top vertical\n"
           << (block ? plot.str() : "plot NaN notitle");
  return draw(folder, name, data.str(), commands.str(), 1000);
}

}  // namespace revisit::cli
