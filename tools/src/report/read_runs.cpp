#include <algorithm>
#include <map>
#include <sstream>

#include "cli/json.h"
#include "eval/plan.h"
#include "eval/run_folder.h"
#include "report/report.h"
#include "revisit/base/error.h"
#include "revisit/base/files.h"
#include "revisit/base/text.h"

namespace revisit::cli {
namespace {

namespace fs = std::filesystem;

bool is_file(const fs::path& file) {
  std::error_code none;
  return fs::is_regular_file(file, none);
}

/// Throws InputError unless arrays have one length and rows are those of scans, as the page needs.
void need_consistent(const fs::path& file, const reports::Run& run) {
  const auto need = [&](bool good, const char* what) {
    if (!good) throw InputError(file.string(), ": ", what, ": not a file of revisit");
  };
  const int n = run.frame_size();
  const auto rows = [n](const auto& scans, int least = 0) {
    return std::ranges::all_of(scans, [&](int row) { return least <= row && row < n; });
  };
  need(run.file_size() == n, "scans without a file");
  for (const int size : {run.x_size(), run.yaw_deg_size()})
    need(size == 0 || size == n, "not all scans have a place or an alignment");
  need(run.z_size() == run.x_size() && run.eigenvalue_ratio_size() == run.yaw_deg_size() &&
           run.abs_t11_size() == run.yaw_deg_size() && rows(run.mirrored()),
       "scans");
  for (const reports::RunTask& task : run.tasks()) {
    const int queries = task.scan_size(), matches = task.match_size();
    need(task.score_size() == queries && task.flags_size() == queries &&
             task.similarity_size() == matches &&
             (queries == 0 ? matches == 0 : matches >= queries && matches % queries == 0) &&
             rows(task.stored()) && rows(task.scan()) && rows(task.match(), -1),
         "queries");
  }
}

/// Returns the index of the run in the page. `indices`: of the runs that are read, by folder.
int read_run(const fs::path& folder, std::map<fs::path, int>& indices, reports::Page& page) {
  const fs::path name = fs::weakly_canonical(folder);
  const auto [entry, fresh] = indices.try_emplace(name, page.runs_size());
  if (!fresh) return entry->second;
  reports::Run& run = *page.add_runs();
  read_report(name / "run.json", &run);
  need_consistent(name / "run.json", run);
  run.set_folder(name.string());
  run.clear_scans_of();  // this and the next belong to the page
  for (reports::RunTask& task : *run.mutable_tasks()) task.clear_shown();
  return entry->second;
}

/// `folder` itself, or folders below it.
std::vector<fs::path> folders_with(const fs::path& folder, const char* file) {
  if (is_file(folder / file)) return {folder};
  std::vector<fs::path> found;
  std::error_code error;
  for (fs::recursive_directory_iterator entry(folder, error), end; !error && entry != end;
       entry.increment(error))
    if (entry->path().filename() == file) found.push_back(entry->path().parent_path());
  std::sort(found.begin(), found.end());
  return found;
}

void read_loops(const fs::path& file, reports::LoopList* loops) {
  loops->set_title(file.filename().string());
  const std::string content = read_content(file);
  for (size_t begin = 0, end = 0, line = 1; (end = content.find('\n', begin)) != std::string::npos;
       begin = end + 1, ++line) {
    if (end == begin) continue;
    const std::string name = str(file.string(), ":", line);
    reports::LoopLine& loop = *loops->add_lines();
    parse_report(content.substr(begin, end - begin), name, &loop);
    if (!loop.has_frame())
      throw InputError(name + ": not a line of `revisit loops --format jsonl`");
  }
}

std::vector<std::string> cells_of(const std::string& line) {
  std::vector<std::string> cells(1);
  for (const char c : line)
    if (c == ',')
      cells.emplace_back();
    else if (c != '\r' && c != ' ' && c != '"')
      cells.back().push_back(c);
  return cells;
}

/// One line of a .csv file of matches, by the columns of its header.
MatchLabel label_of(const std::vector<std::string>& columns, const std::string& line,
                    const std::string& where) {
  const std::vector<std::string> cells = cells_of(line);
  const auto cell = [&](const std::string& name) -> std::string {
    const auto at = static_cast<size_t>(std::ranges::find(columns, name) - columns.begin());
    return at < columns.size() && at < cells.size() ? cells[at] : "";
  };
  const auto truth = [&](const char* name, std::optional<bool> absent) {
    const std::string text = lower(cell(name));
    if (text == "1" || text == "true") return true;
    if (text == "0" || text == "false") return false;
    if (!text.empty() || !absent)
      throw InputError(where, ": ", name, ": expected 0 or 1, found '", text, "'");
    return *absent;
  };
  const bool correct = truth("correct", std::nullopt);
  const auto score = parse_value<double>(where + ": score", cell("score"));
  return {score, correct, truth("positive", correct), truth("ignored", false)};
}

/// Columns score and correct, perhaps positive (default: correct) and ignored (default: 0).
void read_matches(const fs::path& file, reports::Run* run) {
  std::istringstream lines(read_content(file));
  std::string line;
  std::getline(lines, line);
  if (line.starts_with("\xEF\xBB\xBF")) line.erase(0, 3);  // byte order mark
  const std::vector<std::string> columns = cells_of(line);
  for (const char* name : {"score", "correct"})
    if (std::ranges::find(columns, name) == columns.end())
      throw InputError(file.string(), ": expected the columns score and correct, found ",
                       line.empty() ? "nothing" : joined(columns, ", "),
                       "; of loops: the lines of `revisit loops --all --format jsonl`");
  std::vector<MatchLabel> labels;
  for (int number = 2; std::getline(lines, line); ++number) try {
      if (!line.empty() && line != "\r")
        labels.push_back(label_of(columns, line, str(file.string(), ":", number)));
    } catch (const UsageError& error) {
      throw InputError(error.what());
    }
  if (labels.empty()) throw InputError(file.string(), ": no matches after the header");
  run->set_folder(file.string());
  run->mutable_info()->set_data(fs::absolute(file).string());
  run->mutable_info()->set_feature(file.filename().string());
  TaskResult result;
  result.task.name = "matches";
  result.summary = summarize(labels);
  reports::RunTask& task = *run->add_tasks();
  *task.mutable_metrics() = metrics_report(result.summary, result.task, "");
  *task.mutable_curve() = drawn_curve(precision_recall(labels));
}

ptrdiff_t table_position(const std::string& name) {
  const auto& all = paper_experiments();
  return std::ranges::find_if(all, [&](const auto& one) { return one.name() == name; }) -
         all.begin();
}

}  // namespace

reports::Page read_runs(const std::vector<fs::path>& folders) {
  reports::Page page;
  std::map<fs::path, int> indices;  // of runs, by folder
  std::vector<std::pair<reports::Experiment, fs::path>> found;
  for (const fs::path& folder : folders) {
    if (is_file(folder) && folder.extension() == ".csv") {
      read_matches(folder, page.add_runs());
      continue;
    }
    if (is_file(folder)) {
      read_loops(folder, page.add_loops());
      continue;
    }
    if (!fs::exists(folder)) throw InputError(folder.string(), ": No such file or directory");
    const std::vector<fs::path> of_experiments = folders_with(folder, "experiment.json");
    for (const fs::path& experiment : of_experiments) {
      found.emplace_back(reports::Experiment{}, experiment);
      read_report(experiment / "experiment.json", &found.back().first);
    }
    if (!of_experiments.empty()) continue;
    const std::vector<fs::path> of_runs = folders_with(folder, "run.json");
    if (of_runs.empty())
      throw InputError(folder.string(),
                       ": no run.json or experiment.json found in or below the folder; "
                       "'revisit eval' writes them");
    for (const fs::path& run : of_runs) read_run(run, indices, page);
  }
  std::ranges::stable_sort(
      found, {}, [](const auto& experiment) { return table_position(experiment.first.name()); });
  for (auto& [experiment, folder] : found) {
    for (reports::ExperimentRun& run : *experiment.mutable_runs()) {
      run.clear_run();
      if (run.state() == "done") run.set_run(read_run(folder / run.folder(), indices, page));
    }
    *page.add_experiments() = std::move(experiment);
  }
  return page;
}

}  // namespace revisit::cli
