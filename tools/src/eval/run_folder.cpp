#include "run_folder.h"

#include <yaml-cpp/yaml.h>

#include <cmath>
#include <numbers>

#include "cli/json.h"
#include "cli/local_time.h"
#include "cli/messages.h"
#include "cli/printable.h"
#include "cli/table.h"
#include "eval/run_data.h"
#include "eval/run_info.h"
#include "revisit/base/files.h"
#include "revisit/base/text.h"

namespace revisit::cli {
namespace {

namespace fs = std::filesystem;

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

/// Leaves `accepted` blank without a best F1, and leaves `true` blank without a label. Scores have
/// all digits, because one of them is the threshold.
void write_loops(const fs::path& file, const RunContext& context, const TaskResult& result) {
  Table table({"query_index", "match_index", "rank", "query_time", "match_time", "similarity",
               "score", "margin", "yaw_deg", "accepted", "true", "positive", "case"});
  const auto time_of = [&](int64_t scan) {
    return context.trajectory.times.empty()
               ? ""
               : number(context.trajectory.times[static_cast<size_t>(scan)], 6);
  };
  const bool has_threshold = !std::isnan(result.summary.f1_max_threshold);
  const std::vector<bool> accepted = result.accepted();
  for (size_t q = 0; q < result.matches.size(); ++q) {
    const Match& match = result.matches[q];
    for (size_t rank = 0; rank < match.ranks.size(); ++rank) {
      std::vector<std::string> row{
          str(context.trajectory.frames[static_cast<size_t>(match.query)]),
          str(context.trajectory.frames[static_cast<size_t>(match.ranks[rank])]),
          str(rank + 1),
          time_of(match.query),
          time_of(match.ranks[rank]),
          number(match.similarities[rank], 6)};
      if (rank == 0)
        row.insert(
            row.end(),
            {exact(match.score), number(match.similarities[0] - match.similarities.back(), 6),
             number(relative_yaw_deg(match, context.alignments), 2),
             has_threshold ? str(accepted[q] ? 1 : 0) : "",
             result.labels[q].ignored ? "" : str(result.labels[q].correct ? 1 : 0),
             str(result.labels[q].positive ? 1 : 0), str(match.which_case)});
      table.row(std::move(row));
    }
  }
  write_atomically(file, [&](std::ostream& out) { table.print_csv(out); });
}

void write_scans(const fs::path& file, const RunContext& context,
                 const std::vector<TaskResult>& results) {
  std::vector<std::string> stored(context.dataset.scans.size());
  for (const TaskResult& result : results)
    for (const int64_t scan : result.task.stored) {
      std::string& tasks = stored[static_cast<size_t>(scan)];
      tasks += (tasks.empty() ? "" : " ") + result.task.name;
    }
  Table table({"frame", "file", "time", "x", "y", "z", "yaw_deg", "eigenvalue_ratio", "abs_t11",
               "mirrored_choice", "outside", "stored"});
  for (size_t i = 0; i < context.dataset.scans.size(); ++i) {
    const ScanRef& scan = context.dataset.scans[i];
    const auto position = [&](int axis) {
      return context.trajectory.positions.empty()
                 ? ""
                 : number(context.trajectory.positions[i][axis], 3);
    };
    const AlignmentRecord& a = context.alignments[i];
    table.row({str(scan.frame), fs::absolute(scan.file).string(),
               scan.time ? number(*scan.time, 6) : "", position(0), position(1), position(2),
               number(a.yaw * 180 / std::numbers::pi, 3), number(a.eigenvalue_ratio, 4),
               number(a.abs_t11, 4), number(a.mirrored_choice, 0), number(a.outside, 4),
               stored[i]});
  }
  write_atomically(file, [&](std::ostream& out) { table.print_csv(out); });
}

const char* pose_source_of(Distance distance) {
  if (distance == Distance::kPairs) return "list of pairs";
  return distance == Distance::kPlace ? "names of the places" : "poses of the data set";
}

}  // namespace

fs::path make_run_folder(const fs::path& output, const Dataset& dataset) {
  const std::string name =
      dataset.sequence.empty() ? dataset.name : dataset.name + "_" + dataset.sequence;
  const fs::path parent = output / name;
  std::error_code error;
  fs::create_directories(parent, error);
  const std::string time = local_time("%Y-%m-%d_%H-%M-%S");
  fs::path run = parent / time;
  for (int i = 2; !error && !fs::create_directory(run, error) && !error; ++i)
    run = parent / str(time, "_", i);
  if (error) throw Error(run.string(), ": cannot create the folder: ", error.message());
  return run;
}

void link_latest(const fs::path& run) {
  const fs::path link = run.parent_path() / "latest";
  const fs::path fresh = run.parent_path() / ".latest.part";
  std::error_code error;
  if (fs::exists(fs::symlink_status(link)) && !fs::is_symlink(link)) {  // not written by eval
    warn(
        str(link.string(), " is not a link and was not changed; the latest run is ", run.string()));
    return;
  }
  fs::remove(fresh, error);
  fs::create_directory_symlink(run.filename(), fresh, error);
  if (!error) fs::rename(fresh, link, error);
}

fs::path finished_run(const fs::path& output, const std::string& key) {
  std::error_code none;
  for (const fs::directory_entry& data : fs::directory_iterator(output, none)) {
    const fs::path run = data.path() / "latest";
    if (!fs::exists(run / "metrics.json")) continue;
    reports::RunInfo info;
    read_report(run / "run.json", &info);
    if (info.key() == utf8(key)) return fs::canonical(run);
  }
  return "";
}

reports::MetricsList metrics_list(const std::vector<TaskResult>& results, int resamples) {
  reports::MetricsList list;
  for (const TaskResult& result : results) {
    reports::Metrics& metrics = *list.add_tasks();
    metrics =
        metrics_report(result.summary, result.task, pose_source_of(result.task.rule.distance));
    metrics.set_score(name_of(result.score));
    metrics.set_query_case(result.query_case);
    metrics.set_n_left_out(static_cast<int>(result.n_skipped));
    if (result.intervals) add_intervals(metrics, *result.intervals, resamples, result.blocks.all);
    if (!result.loops) continue;
    reports::AcceptedLoops& loops = *metrics.mutable_loops();
    loops.set_threshold(result.loops->threshold);
    loops.set_right(static_cast<int>(result.loops->correct));
    loops.set_neither(static_cast<int>(result.loops->ignored));
    loops.set_wrong(static_cast<int>(result.loops->incorrect));
    if (result.loops->unlabeled > 0)
      loops.set_not_judged(static_cast<int>(result.loops->unlabeled));
  }
  return list;
}

void write_run(const fs::path& run, const RunContext& context,
               const std::vector<TaskResult>& results, const EvaluationTimes& times) {
  write_text(run / "config.yaml", config_yaml(context));
  reports::RunInfo info =
      run_info(context.options, context.dataset, context.source,
               results.empty() ? "" : results.front().pca_fit, times, context.alignments);
  info.set_command(context.command);
  if (!results.empty())
    info.set_descriptor_dimension(static_cast<int>(results.front().descriptor_dim));
  info.set_key(context.key);
  write_json(run / "run.json", info);
  info.clear_key();  // long, and unused by the page
  write_scans(run / "scans.csv", context, results);
  for (const TaskResult& result : results) {
    write_precision_recall_csv(run / ("pr_" + result.task.name + ".csv"), result.curve);
    if (!result.on_pairs())
      write_loops(run / ("loops_" + result.task.name + ".csv"), context, result);
  }
  const reports::MetricsList metrics = metrics_list(results, context.resamples);
  write_text(run / "report.json",
             to_compact_json(run_data(context, results, info, metrics)) + "\n");
  write_json(run / "metrics.json", metrics);
}

}  // namespace revisit::cli
