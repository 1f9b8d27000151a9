#include "report/read_runs.h"

#include <algorithm>
#include <map>

#include "cli/json.h"
#include "experiment/experiment.h"
#include "revisit/base/error.h"
#include "revisit/base/files.h"
#include "robustness/robustness_report.h"

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

class RunReader {
 public:
  explicit RunReader(reports::Page* page) : page_(page) {}
  int read_and_index(const fs::path& folder) {
    const fs::path name = fs::weakly_canonical(folder);
    const auto [entry, fresh] = index_.try_emplace(name, page_->runs_size());
    if (!fresh) return entry->second;
    reports::Run& run = *page_->add_runs();
    read_report(name / "report.json", &run);
    need_consistent(name / "report.json", run);
    run.clear_scans_of();  // this and the next belong to the page
    for (reports::RunTask& task : *run.mutable_tasks()) task.clear_shown();
    return entry->second;
  }

 private:
  reports::Page* page_;
  std::map<fs::path, int> index_;
};

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

void read_and_merge_robustness(const fs::path& file, reports::Page* page) {
  reports::Robustness found;
  read_report(file, &found);
  found.clear_folder();
  const auto rows = [](const reports::RobustnessFeature& feature) { return feature.rows_size(); };
  if (found.features().empty() || rows(found.features(0)) == 0 ||
      !std::ranges::all_of(found.features(), [&](const reports::RobustnessFeature& feature) {
        return rows(feature) == rows(found.features(0));
      }))
    throw InputError(file.string() + ": not a file of `revisit robustness`");
  auto& all = *page->mutable_robustness();
  const auto same = std::ranges::find_if(
      all, [&](const reports::Robustness& other) { return same_question(found, other); });
  if (same == all.end()) {
    *page->add_robustness() = std::move(found);
    return;
  }
  for (reports::RobustnessFeature& feature : *found.mutable_features()) {
    const std::string label = feature.label();
    for (int again = 2; std::ranges::count(same->features(), feature.label(),
                                           &reports::RobustnessFeature::label) > 0;
         ++again)
      feature.set_label(str(label, " (", again, ")"));
    *same->add_features() = std::move(feature);
  }
}

ptrdiff_t table_position(const std::string& name) {
  const auto& all = paper_experiments();
  return std::ranges::find_if(all, [&](const auto& one) { return one.report().name() == name; }) -
         all.begin();
}

}  // namespace

reports::Page read_runs(const std::vector<fs::path>& folders) {
  reports::Page page;
  RunReader runs(&page);
  std::vector<std::pair<reports::Experiment, fs::path>> found;
  for (const fs::path& folder : folders) {
    if (is_file(folder)) {
      read_loops(folder, page.add_loops());
      continue;
    }
    const std::vector<fs::path> of_experiments = folders_with(folder, "experiment.json");
    for (const fs::path& experiment : of_experiments) {
      found.emplace_back(reports::Experiment{}, experiment);
      read_report(experiment / "experiment.json", &found.back().first);
    }
    const std::vector<fs::path> of_robustness = folders_with(folder, "robustness.json");
    for (const fs::path& run : of_robustness)
      read_and_merge_robustness(run / "robustness.json", &page);
    if (!of_experiments.empty()) continue;
    const std::vector<fs::path> of_runs = folders_with(folder, "report.json");
    if (of_runs.empty() && of_robustness.empty())
      throw InputError(
          folder.string() +
          ": no report.json, experiment.json or robustness.json found in or below the "
          "folder; 'revisit eval', 'revisit experiment' and 'revisit robustness' write them");
    for (const fs::path& run : of_runs) runs.read_and_index(run);
  }
  std::ranges::stable_sort(
      found, {}, [](const auto& experiment) { return table_position(experiment.first.name()); });
  for (auto& [experiment, folder] : found) {
    reports::PageExperiment& out = *page.add_experiments();
    for (const reports::ExperimentRun& run : experiment.runs())
      out.add_run(run.state() == "done" ? runs.read_and_index(folder / run.folder()) : -1);
    *out.mutable_experiment() = std::move(experiment);
  }
  return page;
}

}  // namespace revisit::cli
