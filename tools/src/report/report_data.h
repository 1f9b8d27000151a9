#pragma once

#include <filesystem>
#include <string>
#include <utility>
#include <vector>

#include "reports.pb.h"

namespace revisit::cli {

/// Where and how a scan was taken, of a run's scans.csv.
struct ReportScan {
  std::string file;
  int frame = 0;
  double x = 0, z = 0;  // [m] from above: x right, z forward
  double yaw_deg = 0, eigenvalue_ratio = 0, abs_t11 = 0;
  bool mirrored_choice = false;
  std::string stored;  // names of the tasks that store it
};

/// One query of a task and what it found, of a run's loops_<task>.csv.
struct ReportQuery {
  size_t scan = 0;                   // index into the scans
  std::vector<size_t> matches;       // the same, best first
  std::vector<double> similarities;  // of the matches
  double score = 0;
  bool accepted = false, correct = false, positive = false;
  bool ignored = false;  // neither right nor wrong
  int which_case = 1;
};

struct ReportTask {
  reports::Metrics metrics;
  google::protobuf::RepeatedPtrField<reports::CurvePoint> curve;
  std::vector<ReportQuery> queries;
};

/// A run as its folder has it.
struct ReportRun {
  std::filesystem::path folder;
  reports::RunInfo info;
  std::vector<std::pair<std::string, std::string>> configuration;
  std::vector<ReportScan> scans;
  std::vector<ReportTask> tasks;
};

/// Everything a report shows.
struct ReportData {
  std::vector<reports::Experiment> experiments;
  std::vector<ReportRun> runs;
  /// For each experiment, for each of its runs: index into `runs`, or -1.
  std::vector<std::vector<int>> run_of;
};

/// Reads folders of runs (metrics.json), of experiments (experiment.json), and folders that have
/// such below them. A run that several experiments share is read once. Throws InputError for a
/// folder with neither and for files that are not as revisit writes them: their names of protocols,
/// sequences and experiments become names of files.
ReportData read_report_data(const std::vector<std::filesystem::path>& folders);

}  // namespace revisit::cli
