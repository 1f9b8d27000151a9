#include "run_folder.h"

#include <sys/resource.h>
#include <yaml-cpp/yaml.h>

#include <algorithm>
#include <cmath>
#include <ctime>
#include <iomanip>
#include <numbers>
#include <numeric>

#include "cli/json.h"
#include "cli/table.h"
#include "plots/metrics_report.h"
#include "revisit/engine/profile.h"
#include "revisit/proto/atomic_file.h"

namespace revisit::cli {
namespace {

namespace fs = std::filesystem;

std::string local_time() {
  const std::time_t now = std::time(nullptr);
  std::tm parts{};
  localtime_r(&now, &parts);
  std::ostringstream text;
  text << std::put_time(&parts, "%Y-%m-%d_%H-%M-%S");
  return text.str();
}

void write_text(const fs::path& file, const std::string& text) {
  write_atomically(file, [&](std::ostream& out) { out << text; });
}

std::string config_yaml(const RunContext& context) {
  YAML::Emitter out;
  out << YAML::Comment("The options of this run: revisit eval DATA --config config.yaml")
      << YAML::BeginMap;
  for (const auto& [name, value] : context.settings)
    if (!value.empty()) out << YAML::Key << name << YAML::Value << value;
  out << YAML::EndMap;
  return std::string(out.c_str()) + "\n";
}

reports::RunInfo run_info(const RunContext& context, const std::vector<TaskResult>& results,
                          const pipeline::DescribeTimes& times) {
  reports::RunInfo info;
  info.set_version(REVISIT_VERSION);
  info.set_data(fs::absolute(context.options.data).string());
  info.set_sequence(context.dataset.sequence);
  info.set_scans(static_cast<int>(context.dataset.scans.size()));
  info.set_feature(context.source.extractor.name);
  info.set_feature_dimension(static_cast<double>(context.source.extractor.dim));
  if (const auto& model = context.source.model) {
    info.set_model(model->prototxt.string());
    info.set_weights(model->weights.string());
    info.set_weights_sha1(model->weights_sha1);
    info.set_trained(model->trained);
    for (const double mean : model->mean_bgr) info.add_mean_bgr(mean);
  }
  const pipeline::ImageGeometry g = context.options.geometry();
  info.set_image_width(g.width);
  info.set_image_height(g.height);
  info.set_elevation_top_deg(g.elevation_top);
  info.set_elevation_bottom_deg(g.elevation_bottom);
  info.set_max_range_m(g.max_range);
  info.set_pca_fit(results.empty() ? "" : results.front().pca_fit);
  info.set_threads(context.options.thread_count());
  const std::pair<const char*, const std::vector<double>&> stages[] = {
      {"read", times.read},   {"align", times.align},     {"project", times.project},
      {"close", times.close}, {"feature", times.feature}, {"write", times.write}};
  for (const auto& [stage, samples] : stages) {
    if (samples.empty()) continue;
    const engine::Timing timing = engine::summarize(samples);
    reports::Stage& out = *info.add_stages();
    out.set_name(stage);
    out.set_count(static_cast<int>(samples.size()));
    out.set_median_ms(timing.median);
    out.set_p95_ms(timing.p95);
    out.set_total_ms(std::accumulate(samples.begin(), samples.end(), 0.0));
  }
  if (const auto speed = frames_per_second(times)) info.set_frames_per_second(*speed);
  info.set_align(pipeline::name_of(context.source.align));
  rusage usage{};
  getrusage(RUSAGE_SELF, &usage);
  info.set_peak_resident_bytes(static_cast<double>(usage.ru_maxrss) * 1024);
  return info;
}

/// One line a retrieved scan; score, margin and yaw belong to the best.
void write_loops(const fs::path& file, const RunContext& context, const TaskResult& result) {
  Table table({"query_index", "match_index", "rank", "query_time", "match_time", "cosine", "score",
               "margin", "yaw_deg", "accepted", "true"});
  const auto time_of = [&](int64_t scan) {
    return context.trajectory.times.empty()
               ? ""
               : number(context.trajectory.times[static_cast<size_t>(scan)], 6);
  };
  for (size_t q = 0; q < result.matches.size(); ++q) {
    const pipeline::Match& match = result.matches[q];
    for (size_t rank = 0; rank < match.ranks.size(); ++rank) {
      std::vector<std::string> row{
          str(context.trajectory.frames[static_cast<size_t>(match.query)]),
          str(context.trajectory.frames[static_cast<size_t>(match.ranks[rank])]),
          str(rank + 1),
          time_of(match.query),
          time_of(match.ranks[rank]),
          number(match.similarities[rank], 6)};
      if (rank == 0) {
        // Accepted at the threshold of the best F1; blank when there is none.
        const double threshold = result.summary.f1_max_threshold;
        row.insert(row.end(), {number(match.score, 6),
                               number(match.similarities[0] - match.similarities.back(), 6),
                               number(relative_yaw_deg(match, context.alignments), 2),
                               std::isnan(threshold) ? "" : str(match.score >= threshold ? 1 : 0),
                               str(result.verdicts[q].correct ? 1 : 0)});
      }
      table.row(std::move(row));
    }
  }
  write_atomically(file, [&](std::ostream& out) { table.print_csv(out); });
}

}  // namespace

fs::path make_run_folder(const fs::path& output, const pipeline::Dataset& dataset) {
  const std::string name =
      dataset.sequence.empty() ? dataset.name : dataset.name + "_" + dataset.sequence;
  const fs::path parent = output / name;
  std::error_code error;
  fs::create_directories(parent, error);
  const std::string time = local_time();
  fs::path run = parent / time;
  for (int i = 2; !error && !fs::create_directory(run, error) && !error; ++i)
    run = parent / str(time, "_", i);
  if (error) throw Error(str(run.string(), ": cannot create the folder: ", error.message()));
  return run;
}

void link_latest(const fs::path& run) {
  const fs::path link = run.parent_path() / "latest";
  const fs::path fresh = run.parent_path() / ".latest.part";
  std::error_code error;
  fs::remove(fresh, error);
  fs::create_directory_symlink(run.filename(), fresh, error);
  if (!error) fs::rename(fresh, link, error);
}

double relative_yaw_deg(const pipeline::Match& match,
                        const std::vector<pipeline::AlignmentRecord>& alignments) {
  // The place's direction is seen at yaw_q from the query and at yaw_m from the match: the heading
  // differs by yaw_m - yaw_q. Case 2 looks along the opposite direction.
  const double query = alignments[static_cast<size_t>(match.query)].yaw;
  const double stored = alignments[static_cast<size_t>(match.ranks.at(0))].yaw;
  const double turned = match.which_case == 2 ? 180.0 : 0.0;
  return std::remainder((stored - query) * 180.0 / std::numbers::pi + turned, 360.0);
}

reports::MetricsList metrics_list(const std::vector<TaskResult>& results) {
  reports::MetricsList list;
  for (const TaskResult& result : results)
    *list.add_tasks() =
        metrics_report(result.summary, result.task, result.rule, "poses of the data set");
  return list;
}

void write_run(const fs::path& run, const RunContext& context,
               const std::vector<TaskResult>& results, const pipeline::DescribeTimes& times) {
  write_text(run / "config.yaml", config_yaml(context));
  write_text(run / "run.json", to_json(run_info(context, results, times)) + "\n");
  for (const TaskResult& result : results) {
    pipeline::write_precision_recall_csv(run / ("pr_" + result.task.name + ".csv"), result.curve);
    write_loops(run / ("loops_" + result.task.name + ".csv"), context, result);
  }
  write_text(run / "metrics.json", to_json(metrics_list(results)) + "\n");
}

}  // namespace revisit::cli
