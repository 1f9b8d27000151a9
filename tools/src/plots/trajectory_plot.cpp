#include <algorithm>
#include <cmath>
#include <sstream>

#include "plots/plots.h"
#include "revisit/proto/error.h"

namespace revisit::cli {
namespace {

/// Dots of one colour on the map.
struct Layer {
  const char* legend;
  const char* colour;  // rrggbb
  double dot_size;
  std::ostringstream rows;  // x z [m], and those of the match
  int64_t count = 0;
  int block = -1;  // in the data file
};

/// Size of the map [pixels], and the ranges that fill it in equal scales.
struct Frame {
  double x_min, x_max, z_min, z_max;
  int height;
};

constexpr double kMapWidth = 1100, kAround = 190;  // [pixels], what the title, axes and legend take

Frame frame_of(const pipeline::Trajectory& trajectory) {
  Eigen::Vector3d low = trajectory.positions.front(), high = low;
  for (const Eigen::Vector3d& position : trajectory.positions) {
    low = low.cwiseMin(position);
    high = high.cwiseMax(position);
  }
  const double margin = 0.04 * std::max({high.x() - low.x(), high.z() - low.z(), 10.0});
  Frame frame{low.x() - margin, high.x() + margin, low.z() - margin, high.z() + margin, 0};
  const double ratio = (frame.z_max - frame.z_min) / (frame.x_max - frame.x_min);
  frame.height = static_cast<int>(kAround + std::clamp(kMapWidth * ratio, 300.0, 1200.0));
  return frame;
}

/// The way the vehicle took, x z [m] a line, with a blank line where it is not known: scans much
/// farther apart than the others were not taken one after another.
std::string path_rows(const pipeline::Trajectory& trajectory) {
  const auto& at = trajectory.positions;
  std::vector<double> steps;
  for (size_t i = 1; i < at.size(); ++i) steps.push_back((at[i] - at[i - 1]).norm());
  std::vector<double> sorted = steps;
  std::ranges::sort(sorted);
  const double longest = sorted.empty() ? 0 : std::max(10.0, 5 * sorted[sorted.size() / 2]);
  std::ostringstream rows;
  for (size_t i = 0; i < at.size(); ++i) {
    if (i > 0 && steps[i - 1] > longest) rows << "\n";
    rows << at[i].x() << " " << at[i].z() << "\n";
  }
  return std::move(rows).str();
}

/// Many lines are drawn fainter, so that the dots stay visible.
std::string line_colour(const Layer& layer) {
  return layer.count > 300 ? str("'#c0", layer.colour, "'") : str("'#60", layer.colour, "'");
}

}  // namespace

PlotFiles plot_trajectory(const std::filesystem::path& folder, const std::string& name,
                          const std::string& title, const pipeline::Trajectory& trajectory,
                          const pipeline::Task& task, const std::vector<pipeline::Match>& matches,
                          const std::vector<pipeline::Verdict>& verdicts,
                          const std::vector<bool>& accepted) {
  if (trajectory.positions.empty())
    throw UsageError("the map of a drive needs poses; this data set has none");
  if (matches.size() != verdicts.size() || matches.size() != accepted.size())
    throw Error(str(matches.size(), " matches, ", verdicts.size(), " verdicts and ",
                    accepted.size(), " decisions do not belong together"));
  Layer layers[] = {{"queries", "bdbdbd", 0.4, {}},
                    {"stored", "3b76b5", 0.4, {}},
                    {"missed", "f39c12", 0.6, {}},
                    {"right", "1a9641", 0.6, {}},
                    {"wrong", "d7191c", 0.6, {}}};
  auto& [queries, stored, missed, right, wrong] = layers;
  const auto add = [&](Layer& layer, int64_t scan, int64_t match) {
    const Eigen::Vector3d& a = trajectory.positions.at(scan);
    const Eigen::Vector3d& b = trajectory.positions.at(match);
    layer.rows << a.x() << " " << a.z() << " " << b.x() << " " << b.z() << "\n";
    ++layer.count;
  };
  // Where every scan is both (online), the path is drawn once.
  const bool all_stored = task.stored.size() == trajectory.frames.size();
  if (all_stored) queries.legend = "stored and asked";
  for (const int64_t scan : task.stored) add(all_stored ? queries : stored, scan, scan);
  for (size_t i = 0; i < matches.size(); ++i) {
    if (!all_stored) add(queries, matches[i].query, matches[i].query);
    if (verdicts[i].ignored) continue;
    if (accepted[i] && !matches[i].ranks.empty())
      add(verdicts[i].correct ? right : wrong, matches[i].query, matches[i].ranks[0]);
    else if (verdicts[i].positive)
      add(missed, matches[i].query, matches[i].query);
  }

  std::ostringstream data;
  std::vector<std::string> plots;
  data << "# x z [m] of the path; then x z match_x match_z [m], blocks:";
  int blocks = 1;  // after the path
  for (Layer& layer : layers) {
    if (layer.count == 0) continue;
    layer.block = blocks++;
    data << " " << layer.legend << ";";
  }
  data << "\n" << path_rows(trajectory) << "\n\n";
  plots.push_back(quoted(name + ".dat") +
                  " index 0 using 1:2 with lines linewidth 1.4 linecolor rgb '#d5dae0' notitle");
  const auto source = [&](const Layer& layer) {
    return str(quoted(name + ".dat"), " index ", layer.block);
  };
  const auto draw_lines = [&](const Layer& layer) {
    if (layer.count)
      plots.push_back(str(source(layer),
                          " using 1:2:($3-$1):($4-$2) with vectors nohead linewidth 1",
                          " linecolor rgb ", line_colour(layer), " notitle"));
  };
  const auto draw_dots = [&](const Layer& layer) {
    if (!layer.count) return;
    const std::string style = str("with points pointtype 7 linecolor rgb '#", layer.colour, "' ");
    plots.push_back(
        str(source(layer), " using 1:2 ", style, "pointsize ", layer.dot_size, " notitle"));
    // The legend has a dot of its own: those of the map are too small to tell their colour there.
    plots.push_back(str("NaN ", style, "pointsize 1.4 title ",
                        quoted(str(layer.legend, " (", layer.count, ")"))));
  };
  for (const Layer& layer : layers)
    if (layer.count) data << layer.rows.str() << "\n\n";
  draw_dots(queries);
  draw_dots(stored);
  draw_lines(wrong);
  draw_lines(right);
  draw_dots(missed);
  draw_dots(right);
  draw_dots(wrong);

  const Frame frame = frame_of(trajectory);
  std::ostringstream commands;
  commands << "set title " << quoted(title) << "\n"
           << "set xlabel 'x, right [m]'\nset ylabel 'z, forward [m]'\n"
           << "set size ratio -1\n"
           << "set xrange [" << frame.x_min << ":" << frame.x_max << "]\n"
           << "set yrange [" << frame.z_min << ":" << frame.z_max << "]\n"
           << "set key outside below center horizontal Left reverse samplen 1 width 1 height 1.6\n"
           << "plot ";
  for (size_t i = 0; i < plots.size(); ++i) commands << (i ? ", \\\n  " : "") << plots[i];
  return draw(folder, name, data.str(), commands.str(), frame.height);
}

}  // namespace revisit::cli
