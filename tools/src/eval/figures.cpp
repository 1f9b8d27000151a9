#include "figures.h"

#include <cmath>
#include <optional>
#include <set>
#include <sstream>
#include <tuple>

#include "cli/messages.h"
#include "cli/table.h"
#include "plots/plots.h"
#include "revisit/pipeline/gray_png.h"
#include "revisit/pipeline/scan_file.h"

namespace revisit::cli {
namespace {

namespace fs = std::filesystem;

/// The query to show: a right match rather than a wrong one, of another pass rather than a
/// neighbour in time, and then the one with the highest score.
std::optional<size_t> showcase(const RunContext& context, const TaskResult& result) {
  constexpr int kAnotherPass = 50;  // frames
  const auto frame = [&](int64_t scan) {
    return context.trajectory.frames[static_cast<size_t>(scan)];
  };
  const auto merit = [&](size_t q) {
    const pipeline::Match& match = result.matches[q];
    const bool far = std::abs(frame(match.query) - frame(match.ranks[0])) > kAnotherPass;
    return std::tuple(result.verdicts[q].correct, far, match.score);
  };
  std::optional<size_t> best;
  for (size_t q = 0; q < result.matches.size(); ++q)
    if (!best || merit(q) > merit(*best)) best = q;
  return best;
}

/// Writes the range image of a scan as the features see it; returns its file name.
std::string write_image(const fs::path& run, const std::string& name, const RunContext& context,
                        int64_t scan, pipeline::AlignMode align) {
  const auto& ref = context.dataset.scans[static_cast<size_t>(scan)];
  const pipeline::RangeImage image = pipeline::scan_to_image(pipeline::read_scan(ref.file), align,
                                                             context.options.image.geometry());
  const std::string file = name + ".png";
  pipeline::write_png((run / file).string(), image);
  return file;
}

PlotFiles plot_match(const fs::path& run, const RunContext& context, const TaskResult& result,
                     size_t q, pipeline::AlignMode align) {
  const pipeline::Match& match = result.matches[q];
  const std::string name = "match_" + result.task.name;
  const auto frame = [&](int64_t scan) {
    return context.trajectory.frames[static_cast<size_t>(scan)];
  };
  const auto position = [&](int64_t scan) {
    return context.trajectory.positions[static_cast<size_t>(scan)];
  };
  const bool turned = match.which_case == 2;
  const std::string query_image = write_image(run, name + "_query", context, match.query,
                                              turned ? pipeline::AlignMode::kCase2 : align);
  const std::string match_image = write_image(run, name + "_best", context, match.ranks[0], align);

  std::ostringstream data;
  data << "# x z of every scan [m]; then the query and its best match\n";
  for (const auto& p : context.trajectory.positions) data << p.x() << " " << p.z() << "\n";
  data << "\n\n";
  for (const int64_t scan : {match.query, match.ranks[0]})
    data << position(scan).x() << " " << position(scan).z() << "\n";

  const auto image_panel = [&](const std::string& file, const std::string& title, double bottom) {
    return str("set origin 0, ", bottom, "\nset size 1, 0.26\nset title ", quoted(title), "\nplot ",
               quoted(file), " binary filetype=png with rgbimage notitle\n");
  };
  const double apart = pipeline::distance_between(position(match.query), position(match.ranks[0]),
                                                  result.rule.distance);
  std::ostringstream commands;
  commands
      << "set multiplot\n"
      << "set origin 0, 0.5\nset size 1, 0.5\nset size ratio -1\nset key outside right top\nunset "
         "xtics\nunset ytics\n"
      << "set title "
      << quoted(str("query ", frame(match.query), " and its best match ", frame(match.ranks[0]),
                    ": ", similarity_name(context.source), " ", number(match.similarities[0], 3),
                    ", score ", number(match.score, 3), ", ", number(apart, 1),
                    " m apart: ", result.verdicts[q].correct ? "right" : "wrong"))
      << "\nplot '" << name
      << ".dat' index 0 with points pt 7 ps 0.3 lc rgb '#999999' title 'all scans', '' index 1 "
         "every ::0::0 with "
      << "points pt 7 ps 2 lc rgb '#1f77b4' title 'query', '' index 1 every ::1::1 with points pt "
         "7 ps 2 lc rgb "
      << (result.verdicts[q].correct ? "'#2ca02c'" : "'#d62728'") << " title 'best match'\n"
      << "set size noratio\nunset key\nset "
         "autoscale xfix\nset autoscale yfix\n"
      << image_panel(query_image,
                     str("range image of the query, scan ", frame(match.query),
                         turned ? " (case 2: turned by 180 degrees)" : ""),
                     0.25)
      << image_panel(match_image,
                     str("range image of the best match, scan ", frame(match.ranks[0])), 0.0)
      << "unset multiplot\n";
  return draw(run, name, data.str(), commands.str(), 900);
}

}  // namespace

void write_figures(const fs::path& run, const RunContext& context,
                   const std::vector<TaskResult>& results, pipeline::AlignMode align) {
  std::set<std::string> warnings;
  const auto keep = [&](const PlotFiles& plot) {
    if (!plot.warning.empty()) warnings.insert(plot.warning);
  };
  const std::string what = str(context.dataset.name, context.dataset.sequence.empty() ? "" : " ",
                               context.dataset.sequence, ", ", context.source.extractor.name);
  std::vector<PrCurve> curves;
  for (const TaskResult& r : results)
    curves.push_back({r.task.name, r.curve, r.summary.average_precision});
  keep(plot_precision_recall(run, "precision_recall", what, curves));
  for (const TaskResult& r : results) {
    const std::string title = what + ", " + r.task.name;
    const double threshold = r.summary.f1_max_threshold;
    if (r.on_pairs()) {
      keep(plot_pair_scores(run, "scores_" + r.task.name, title, *r.histogram, threshold));
      continue;
    }
    keep(plot_scores(run, "scores_" + r.task.name, title, r.verdicts, threshold));
    if (context.trajectory.positions.empty()) continue;  // named places: no map
    keep(plot_trajectory(run, "trajectory_" + r.task.name, title, context.trajectory, r.task,
                         r.matches, r.verdicts, r.accepted()));
    if (const auto q = showcase(context, r)) keep(plot_match(run, context, r, *q, align));
  }
  for (const std::string& warning : warnings) warn(warning);
}

}  // namespace revisit::cli
