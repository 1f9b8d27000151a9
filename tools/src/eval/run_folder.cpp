#include "run_folder.h"

#include <cmath>
#include <numbers>

#include "cli/json.h"
#include "cli/terminal.h"
#include "revisit/base/files.h"
#include "revisit/base/text.h"

namespace revisit::cli {
namespace {

namespace fs = std::filesystem;

/// Leaves `accepted` blank without a best F1, and leaves `correct` blank without a label. Scores
/// have all digits, because one of them is the threshold.
void write_loops(const fs::path& file, const RunContext& context, const TaskResult& result) {
  Table table({"query", "match", "rank", "query_time", "match_time", "similarity", "score",
               "margin", "yaw_deg", "accepted", "correct", "positive", "case"});
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
             number(relative_yaw_deg(match, context.result.alignments), 2),
             has_threshold ? str(accepted[q] ? 1 : 0) : "",
             result.labels[q].ignored ? "" : str(result.labels[q].correct ? 1 : 0),
             str(result.labels[q].positive ? 1 : 0), str(match.which_case)});
      table.row(std::move(row));
    }
  }
  write_atomically(file, [&](std::ostream& out) { table.print_csv(out); });
}

/// Thresholds have all digits.
void write_curve(const fs::path& file, const std::vector<PrPoint>& curve) {
  Table table({"threshold", "tp", "fp", "fn", "tn", "precision", "recall", "f1"});
  for (const PrPoint& p : curve)
    table.row({exact(p.threshold), str(p.tp), str(p.fp), str(p.fn), str(p.tn),
               number(p.precision, 6), number(p.recall, 6), number(p.f1, 6)});
  write_atomically(file, [&](std::ostream& out) { table.print_csv(out); });
}

void write_perturbed(const fs::path& file, const std::vector<TaskResult>& results) {
  const auto figure = [](double value) { return std::isnan(value) ? "" : number(value, 6); };
  Table table({"perturbation", "queries", "self", "positives", "neighbor", "ratio_median",
               "ratio_min", "skipped", "recall_at_1", "average_precision"});
  for (const TaskResult& result : results)
    if (const auto& figures = result.perturbed)
      table.row({text_of(figures->perturbation), str(result.summary.n_queries), str(figures->self),
                 str(result.summary.n_positives), str(figures->neighbor),
                 figure(figures->ratio_median), figure(figures->ratio_min), str(figures->skipped),
                 figure(result.summary.recall_at_1), figure(result.summary.average_precision)});
  write_atomically(file, [&](std::ostream& out) { table.print_csv(out); });
}

/// Indented JSON has a line for each of thousands of numbers.
std::string with_numbers_in_a_line(const std::string& json) {
  const auto is_part_of_number = [](char c) { return c == '-' || (c >= '0' && c <= '9'); };
  std::string text;
  for (size_t at = 0; at < json.size(); ++at) {
    const size_t next = json[at] == '\n' ? json.find_first_not_of(" \n", at) : std::string::npos;
    if (next == std::string::npos) {
      text += json[at];
      continue;
    }
    const bool before_number = is_part_of_number(json[next]);
    const bool after_number = json[next] == ']' && is_part_of_number(text.back());
    if (before_number || after_number)
      at = next - 1;
    else
      text += json[at];
  }
  return text;
}

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

}  // namespace

void write_scans(const fs::path& file, const RunContext& context) {
  std::vector<std::string> stored(context.dataset.scans.size());
  for (const TaskResult& result : context.result.tasks)
    for (const int64_t scan : result.task.stored) {
      if (scan >= std::ssize(stored)) break;  // a distractor
      std::string& tasks = stored[static_cast<size_t>(scan)];
      tasks += (tasks.empty() ? "" : " ") + result.task.name;
    }
  Table table({"frame", "file", "time", "x", "y", "z", "yaw_deg", "eigenvalue_ratio", "abs_t11",
               "mirrored_choice", "outside", "described", "stored"});
  for (size_t i = 0; i < context.dataset.scans.size(); ++i) {
    const ScanRef& scan = context.dataset.scans[i];
    const auto position = [&](int axis) {
      return context.trajectory.positions.empty()
                 ? ""
                 : number(context.trajectory.positions[i][axis], 3);
    };
    const AlignmentRecord& a = context.result.alignments[i];
    table.row({str(scan.frame), fs::absolute(scan.file).string(),
               scan.time ? number(*scan.time, 6) : "", position(0), position(1), position(2),
               number(a.yaw * 180 / std::numbers::pi, 3), number(a.eigenvalue_ratio, 4),
               number(a.abs_t11, 4), number(a.mirrored_choice, 0), number(a.outside, 4),
               number(a.described, 0), stored[i]});
  }
  write_atomically(file, [&](std::ostream& out) { table.print_csv(out); });
}

fs::path finished_run(const fs::path& output, const std::string& key) {
  std::error_code none;
  for (const fs::directory_entry& data : fs::directory_iterator(output, none)) {
    const fs::path run = data.path() / "latest";
    if (!fs::exists(run / "run.json")) continue;
    reports::Run found;
    read_report(run / "run.json", &found);
    if (found.info().key() == utf8(key)) return fs::canonical(run);
  }
  return "";
}

fs::path write_run(const RunContext& context) {
  const fs::path run = make_run_folder(context.given.output, context.dataset);
  const std::vector<TaskResult>& results = context.result.tasks;
  write_scans(run / "scans.csv", context);
  if (results.front().perturbed) write_perturbed(run / "perturbed.csv", results);
  for (const TaskResult& result : results) {
    if (result.perturbed) continue;
    write_curve(run / ("pr_" + result.task.name + ".csv"), result.curve);
    if (!result.task.decides_on_pairs)
      write_loops(run / ("loops_" + result.task.name + ".csv"), context, result);
  }
  write_atomically(run / "run.json", [&](std::ostream& out) {
    out << with_numbers_in_a_line(to_json(run_of(context))) << "\n";
  });
  link_latest(run);
  return run;
}

}  // namespace revisit::cli
