#include "report/report_data.h"

#include <algorithm>
#include <cmath>

#include "cli/csv.h"
#include "cli/json.h"
#include "eval/config_file.h"
#include "eval/curve.h"
#include "experiment/catalog.h"
#include "revisit/proto/error.h"

namespace revisit::cli {
namespace {

namespace fs = std::filesystem;

bool is_file(const fs::path& file) {
  std::error_code none;
  return fs::is_regular_file(file, none);
}

/// A name out of a file that becomes part of names of files, read and written.
void need_plain_name(const fs::path& file, const char* field, const std::string& name) {
  const bool odd = std::ranges::any_of(name, [](unsigned char c) { return c == '/' || c < ' '; });
  if (odd || name.empty() || name.starts_with('.'))
    throw InputError(str(file.string(), ": ", field, ": expected a name without '/', found '", name,
                         "'; this is no file of revisit"));
}

std::vector<ReportScan> read_scans(const fs::path& file) {
  const CsvFile csv(file);
  const size_t frame = csv.column("frame"), path = csv.column("file"), x = csv.column("x"),
               z = csv.column("z"), yaw = csv.column("yaw_deg"),
               ratio = csv.column("eigenvalue_ratio"), t11 = csv.column("abs_t11"),
               mirrored = csv.column("mirrored_choice"), stored = csv.column("stored");
  std::vector<ReportScan> scans;
  for (size_t i = 0; i < csv.rows(); ++i)
    scans.push_back({csv.text(i, path), csv.whole_number(i, frame), csv.number(i, x),
                     csv.number(i, z), csv.number(i, yaw), csv.number(i, ratio), csv.number(i, t11),
                     csv.number(i, mirrored) > 0, csv.text(i, stored)});
  return scans;
}

std::vector<ReportQuery> read_queries(const fs::path& file, const std::vector<ReportScan>& scans) {
  std::map<int, size_t> by_frame;
  for (size_t i = 0; i < scans.size(); ++i) by_frame[scans[i].frame] = i;
  const CsvFile csv(file);
  const size_t query = csv.column("query_index"), match = csv.column("match_index"),
               rank = csv.column("rank"), similarity = csv.column("cosine"),
               score = csv.column("score"), accepted = csv.column("accepted"),
               correct = csv.column("true"), positive = csv.column("positive"),
               which_case = csv.column("case");
  const auto scan_of = [&](size_t row, size_t column) {
    const auto found = by_frame.find(csv.whole_number(row, column));
    if (found == by_frame.end())
      throw InputError(
          str(file.string(), ": frame ", csv.text(row, column), " is not in scans.csv"));
    return found->second;
  };
  std::vector<ReportQuery> queries;
  for (size_t i = 0; i < csv.rows(); ++i) {
    if (csv.number(i, rank) == 1) {
      ReportQuery& fresh = queries.emplace_back();
      fresh.scan = scan_of(i, query);
      fresh.score = csv.number(i, score);
      fresh.accepted = csv.number(i, accepted) > 0;
      fresh.correct = csv.number(i, correct) > 0;
      fresh.ignored = csv.text(i, correct).empty();
      fresh.positive = csv.number(i, positive) > 0;
      fresh.which_case = csv.number(i, which_case) == 2 ? 2 : 1;
    } else if (queries.empty()) {
      throw InputError(str(file.string(), ": a query begins with rank ", csv.text(i, rank)));
    }
    queries.back().matches.push_back(scan_of(i, match));
    queries.back().similarities.push_back(csv.number(i, similarity));
  }
  return queries;
}

google::protobuf::RepeatedPtrField<reports::CurvePoint> read_curve(const fs::path& file) {
  const CsvFile csv(file);
  const size_t threshold = csv.column("threshold"), precision = csv.column("precision"),
               recall = csv.column("recall");
  std::vector<pipeline::PrPoint> curve(csv.rows());
  for (size_t i = 0; i < csv.rows(); ++i) {
    curve[i].threshold = csv.number(i, threshold);
    curve[i].precision = csv.number(i, precision);
    curve[i].recall = csv.number(i, recall);
  }
  return drawn_points(curve);
}

ReportRun read_run(const fs::path& folder) {
  ReportRun run;
  run.folder = folder;
  read_report(folder / "run.json", &run.info);
  run.configuration = read_config_file(folder / "config.yaml");
  run.scans = read_scans(folder / "scans.csv");
  reports::MetricsList metrics;
  read_report(folder / "metrics.json", &metrics);
  if (!run.info.sequence().empty())
    need_plain_name(folder / "run.json", "sequence", run.info.sequence());
  for (const reports::Metrics& task : metrics.tasks()) {
    need_plain_name(folder / "metrics.json", "protocol", task.protocol());
    ReportTask& read = run.tasks.emplace_back();
    read.metrics = task;
    read.curve = read_curve(folder / ("pr_" + task.protocol() + ".csv"));
    const fs::path loops = folder / ("loops_" + task.protocol() + ".csv");
    if (is_file(loops)) read.queries = read_queries(loops, run.scans);  // not of pair protocols
  }
  return run;
}

/// Runs by their folders, each once.
class RunReader {
 public:
  explicit RunReader(std::vector<ReportRun>* runs) : runs_(runs) {}
  int read(const fs::path& folder) {
    const fs::path name = fs::weakly_canonical(folder);
    const auto [entry, fresh] = index_.try_emplace(name, static_cast<int>(runs_->size()));
    if (fresh) runs_->push_back(read_run(name));
    return entry->second;
  }

 private:
  std::vector<ReportRun>* runs_;
  std::map<fs::path, int> index_;
};

/// The folders that hold `file`, `folder` itself or what is below it.
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

size_t catalog_position(const std::string& name) {
  const auto& all = experiments();
  return static_cast<size_t>(
      std::find_if(all.begin(), all.end(), [&](const auto& info) { return info.name == name; }) -
      all.begin());
}

}  // namespace

ReportData read_report_data(const std::vector<fs::path>& folders) {
  ReportData data;
  RunReader runs(&data.runs);
  std::vector<fs::path> experiment_folders;
  for (const fs::path& folder : folders) {
    const std::vector<fs::path> found = folders_with(folder, "experiment.json");
    experiment_folders.insert(experiment_folders.end(), found.begin(), found.end());
    if (!found.empty()) continue;
    const std::vector<fs::path> run_folders = folders_with(folder, "metrics.json");
    if (run_folders.empty())
      throw InputError(folder.string() +
                       ": neither a run (metrics.json) nor an experiment (experiment.json) is here "
                       "or below; 'revisit eval' and 'revisit experiment' write them");
    for (const fs::path& run : run_folders) runs.read(run);
  }
  std::vector<std::pair<reports::Experiment, fs::path>> read;
  for (const fs::path& folder : experiment_folders) {
    read.emplace_back(reports::Experiment{}, folder);
    const fs::path file = folder / "experiment.json";
    read_report(file, &read.back().first);
    need_plain_name(file, "name", read.back().first.name());
    for (const reports::ExperimentRun& run : read.back().first.runs())
      need_plain_name(file, "panel", run.panel());
  }
  std::stable_sort(read.begin(), read.end(), [](const auto& a, const auto& b) {
    return catalog_position(a.first.name()) < catalog_position(b.first.name());
  });
  for (auto& [experiment, folder] : read) {
    std::vector<int>& run_of = data.run_of.emplace_back();
    for (const reports::ExperimentRun& run : experiment.runs())
      run_of.push_back(run.state() == "done" ? runs.read(folder / run.folder()) : -1);
    data.experiments.push_back(std::move(experiment));
  }
  return data;
}

}  // namespace revisit::cli
