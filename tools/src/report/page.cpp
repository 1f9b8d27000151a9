#include "report/page.h"

#include <algorithm>
#include <cmath>
#include <fstream>
#include <limits>
#include <set>
#include <sstream>

#include "cli/local_time.h"
#include "experiment/catalog.h"
#include "plots/plots.h"
#include "report/base64.h"
#include "report/range_images.h"
#include "revisit/proto/error.h"
#include "revisit/proto/folder.h"

namespace revisit::cli {
namespace {

namespace fs = std::filesystem;

float rounded(double value, double step) {
  return static_cast<float>(std::round(value / step) * step);
}

reports::PageCurve page_curve(
    const google::protobuf::RepeatedPtrField<reports::CurvePoint>& points) {
  reports::PageCurve curve;
  for (const reports::CurvePoint& point : points) {
    curve.add_threshold(rounded(point.threshold(), 1e-5));
    curve.add_precision(rounded(point.precision(), 1e-5));
    curve.add_recall(rounded(point.recall(), 1e-5));
  }
  return curve;
}

std::string name_of_run(const ReportRun& run) {
  const reports::RunInfo& info = run.info;
  const std::string data = fs::path(info.data()).filename().string();
  std::string title = info.sequence().empty() ? data : info.sequence();
  title += ", " + info.feature();
  if (!info.model().empty() && !info.trained()) title += " (UNTRAINED)";
  const std::set<std::string> shown = {"protocol", "align", "query-case", "score", "pca", "every"};
  for (const auto& [name, value] : run.configuration)
    if (shown.count(name) && value != "case1" && value != "margin" && value != "400" &&
        value != "1" && !(name == "query-case" && value == "protocol"))
      title += ", " + (name == "protocol" ? value : name + " " + value);
  return title;
}

/// The queries worth looking at: accepted wrong ones with the highest scores, missed ones with the
/// lowest, and right ones from all over the drive.
std::vector<std::pair<std::string, const ReportQuery*>> queries_to_show(const ReportTask& task,
                                                                        int most) {
  std::vector<const ReportQuery*> wrong, missed, right;
  for (const ReportQuery& query : task.queries) {
    if (query.ignored) continue;
    if (query.accepted)
      (query.correct ? right : wrong).push_back(&query);
    else if (query.positive)
      missed.push_back(&query);
  }
  const auto by_score = [](const ReportQuery* a, const ReportQuery* b) {
    return a->score > b->score;
  };
  std::stable_sort(wrong.begin(), wrong.end(), by_score);
  std::stable_sort(missed.rbegin(), missed.rend(), by_score);
  std::vector<std::pair<std::string, const ReportQuery*>> shown;
  for (const auto& [kind, all] : {std::pair("wrong", &wrong), {"missed", &missed}})
    for (size_t i = 0; i < all->size() && i < static_cast<size_t>(most); ++i)
      shown.emplace_back(kind, (*all)[i]);
  const size_t n = std::min(right.size(), static_cast<size_t>(most));
  for (size_t i = 0; i < n; ++i)
    shown.emplace_back("right", right[(2 * i + 1) * right.size() / (2 * n)]);
  return shown;
}

void show_queries(const ReportRun& run, const ReportTask& task, const PageOptions& options,
                  RangeImages& images, reports::PageTask* page) {
  for (const auto& [kind, query] : queries_to_show(task, options.queries)) {
    reports::PageShown& shown = *page->add_shown();
    const auto image = [&](size_t scan, bool turned) {
      shown.add_images(images.add(run.scans[scan].file, run.scans[scan].frame, run.info, turned));
    };
    shown.set_kind(kind);
    shown.set_scan(static_cast<int>(query->scan));
    shown.set_score(static_cast<float>(query->score));
    shown.set_which_case(query->which_case);
    image(query->scan, query->which_case == 2);
    for (size_t i = 0; i < query->matches.size() && i < 4; ++i) {
      const ReportScan &a = run.scans[query->scan], &b = run.scans[query->matches[i]];
      shown.add_matches(static_cast<int>(query->matches[i]));
      shown.add_similarities(rounded(query->similarities[i], 1e-5));
      const double apart = std::hypot(a.x - b.x, a.z - b.z);
      if (!std::isnan(apart)) shown.add_distances_m(rounded(apart, 0.01));
      image(query->matches[i], false);
    }
  }
}

int drive_of(const ReportRun& run, reports::Page* page) {
  reports::PageDrive drive;
  drive.set_name(str(run.info.data(), " ", run.info.sequence()));
  for (const ReportScan& scan : run.scans) {
    drive.add_frame(scan.frame);
    if (std::isnan(scan.x) || std::isnan(scan.z)) continue;  // places that are known by name
    drive.add_x(rounded(scan.x, 0.01));
    drive.add_z(rounded(scan.z, 0.01));
  }
  const std::string bytes = drive.SerializeAsString();
  for (int i = 0; i < page->drives_size(); ++i)
    if (page->drives(i).SerializeAsString() == bytes) return i;
  *page->add_drives() = std::move(drive);
  return page->drives_size() - 1;
}

reports::PageTask page_task(const ReportRun& run, const ReportTask& task) {
  reports::PageTask page;
  *page.mutable_metrics() = task.metrics;
  *page.mutable_curve() = page_curve(task.curve);
  for (size_t i = 0; i < run.scans.size(); ++i) {
    std::istringstream names(run.scans[i].stored);
    for (std::string name; names >> name;)
      if (name == task.metrics.protocol()) page.add_stored(static_cast<int>(i));
  }
  for (const ReportQuery& query : task.queries) {
    page.add_scan(static_cast<int>(query.scan));
    page.add_match(query.matches.empty() ? -1 : static_cast<int>(query.matches[0]));
    page.add_score(rounded(query.score, 1e-5));
    page.add_flags(query.accepted + 2 * query.correct + 4 * query.positive + 8 * query.ignored);
  }
  return page;
}

void add_run(const ReportRun& run, bool with_images, const PageOptions& options,
             RangeImages& images, reports::Page* page) {
  const int drive = drive_of(run, page);
  reports::PageRun& out = *page->add_runs();
  out.set_title(name_of_run(run));
  *out.mutable_info() = run.info;
  for (const auto& [name, value] : run.configuration) {
    reports::PageSetting& setting = *out.add_configuration();
    setting.set_name(name);
    setting.set_value(value);
  }
  out.set_drive(drive);
  for (size_t i = 0; i < run.scans.size(); ++i) {
    if (std::isnan(run.scans[i].yaw_deg)) continue;  // camera images
    out.add_yaw_deg(rounded(run.scans[i].yaw_deg, 0.1));
    out.add_eigenvalue_ratio(rounded(run.scans[i].eigenvalue_ratio, 1e-3));
    out.add_abs_t11(rounded(run.scans[i].abs_t11, 1e-3));
    if (run.scans[i].mirrored_choice) out.add_mirrored(static_cast<int>(i));
  }
  for (const ReportTask& task : run.tasks) {
    *out.add_tasks() = page_task(run, task);
    if (with_images)
      show_queries(run, task, options, images, out.mutable_tasks(out.tasks_size() - 1));
  }
}

/// Runs whose queries are shown with their range images: those that were asked for by themselves,
/// else the first one of each drive, the comparison's before others.
std::set<int> runs_to_detail(const ReportData& data) {
  std::set<int> detailed, in_experiments;
  for (const auto& runs : data.run_of) in_experiments.insert(runs.begin(), runs.end());
  for (size_t i = 0; i < data.runs.size(); ++i)
    if (!in_experiments.count(static_cast<int>(i))) detailed.insert(static_cast<int>(i));
  std::set<std::string> drives;
  for (const bool comparison : {true, false})
    for (size_t e = 0; e < data.experiments.size(); ++e) {
      if ((data.experiments[e].name() == "comparison") != comparison) continue;
      for (const int run : data.run_of[e])
        if (run >= 0 && drives.insert(data.runs[static_cast<size_t>(run)].info.sequence()).second)
          detailed.insert(run);
    }
  return detailed;
}

std::vector<PrCurve> curves_of(const reports::Experiment& experiment, const std::string& panel) {
  std::vector<PrCurve> curves;
  for (const reports::ExperimentRun& run : experiment.runs()) {
    if (run.panel() != panel || run.state() != "done") continue;
    PrCurve& curve = curves.emplace_back();
    curve.label = run.label();
    curve.average_precision = run.metrics().has_average_precision()
                                  ? run.metrics().average_precision()
                                  : std::numeric_limits<double>::quiet_NaN();
    for (const reports::CurvePoint& point : run.curve()) {
      pipeline::PrPoint& to = curve.points.emplace_back();
      to.threshold = point.threshold();
      to.precision = point.precision();
      to.recall = point.recall();
    }
  }
  return curves;
}

/// Draws the figures of papers: data, script, SVG and PNG.
class Figures {
 public:
  explicit Figures(const PageOptions& options) : options_(options) {}

  void draw(const reports::Experiment& experiment, reports::PageExperiment* page) {
    std::set<std::string> panels;
    for (const reports::ExperimentRun& run : experiment.runs())
      if (run.state() == "done") panels.insert(run.panel());
    for (const std::string& panel : panels) {
      const PlotFiles plot =
          plot_precision_recall(options_.files, experiment.name() + "_" + panel,
                                experiment.title() + ", " + panel, curves_of(experiment, panel));
      if (!keep(plot) || !options_.static_figures) continue;
      std::ostringstream svg;
      svg << std::ifstream(plot.svg, std::ios::binary).rdbuf();
      reports::PageFigure& figure = *page->add_figures();
      figure.set_panel(panel);
      figure.set_image(data_uri("image/svg+xml", svg.str()));
    }
  }

  void draw(const ReportRun& run, size_t number) {
    pipeline::Trajectory trajectory;
    for (const ReportScan& scan : run.scans) {
      trajectory.frames.push_back(scan.frame);
      trajectory.positions.emplace_back(scan.x, 0, scan.z);
    }
    for (const ReportTask& task : run.tasks) {
      if (task.queries.empty()) continue;
      const bool has_map = !std::isnan(run.scans.front().x);
      pipeline::Task asked;
      const reports::PageTask page = page_task(run, task);
      asked.stored.assign(page.stored().begin(), page.stored().end());
      std::vector<pipeline::Match> matches;
      std::vector<pipeline::Verdict> verdicts;
      std::vector<bool> accepted;
      for (const ReportQuery& query : task.queries) {
        pipeline::Match& match = matches.emplace_back();
        match.query = static_cast<int64_t>(query.scan);
        match.ranks.assign(query.matches.begin(), query.matches.end());
        verdicts.push_back({query.score, query.correct, query.positive, query.ignored});
        accepted.push_back(query.accepted);
      }
      const std::string name = str("run", number, "_", task.metrics.protocol());
      const double threshold = task.metrics.has_f1_max_threshold()
                                   ? task.metrics.f1_max_threshold()
                                   : std::numeric_limits<double>::quiet_NaN();
      const std::string title = name_of_run(run);
      if (has_map)
        keep(plot_trajectory(options_.files, name + "_map", title, trajectory, asked, matches,
                             verdicts, accepted));
      keep(plot_scores(options_.files, name + "_scores", title, verdicts, threshold));
    }
  }

  const std::string& warning() const { return warning_; }

 private:
  bool keep(const PlotFiles& plot) {
    if (!plot.warning.empty()) warning_ = plot.warning;
    return plot.warning.empty();
  }
  const PageOptions& options_;
  std::string warning_;
};

}  // namespace

reports::Page make_page(const ReportData& data, const PageOptions& options) {
  make_folder(options.files);
  reports::Page page;
  page.set_title(options.title);
  page.set_version(REVISIT_VERSION);
  page.set_made(local_time("%Y-%m-%d %H:%M"));
  page.set_command(options.command);
  Figures figures(options);
  RangeImages images(options.files, static_cast<size_t>(options.image_mb * 1e6));
  for (size_t e = 0; e < data.experiments.size(); ++e) {
    reports::PageExperiment& out = *page.add_experiments();
    *out.mutable_experiment() = data.experiments[e];
    for (reports::ExperimentRun& run : *out.mutable_experiment()->mutable_runs()) {
      *out.add_curves() = page_curve(run.curve());
      run.clear_curve();
    }
    for (const int run : data.run_of[e]) out.add_run(run);
    if (!options.no_plots) figures.draw(data.experiments[e], &out);
  }
  const std::set<int> detailed = runs_to_detail(data);
  for (size_t i = 0; i < data.runs.size(); ++i) {
    const bool detail = detailed.count(static_cast<int>(i)) > 0;
    add_run(data.runs[i], detail, options, images, &page);
    if (detail && !options.no_plots) figures.draw(data.runs[i], i + 1);
  }
  page.mutable_images()->insert(images.images().begin(), images.images().end());
  for (const PaperMethod& method : paper_methods()) {
    reports::PageMethod& out = *page.add_methods();
    out.set_feature(method.feature);
    out.set_method(method.method);
    out.set_needs_training(method.needs_training);
    out.set_parameters(method.parameters);
    if (method.frames_per_second > 0) out.set_paper_frames_per_second(method.frames_per_second);
  }
  for (const std::string& warning : {images.warning(), figures.warning()})
    if (!warning.empty()) page.add_warnings(warning);
  return page;
}

}  // namespace revisit::cli
