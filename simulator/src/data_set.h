#pragma once

#include <filesystem>
#include <functional>
#include <set>
#include <span>
#include <string>
#include <vector>

#include "drive.h"
#include "revisit/simulation/simulation.h"

namespace revisit::simulation {

/// Holds one simulation and no other files.
class OutputFolder {
 public:
  using Files = std::set<std::filesystem::path>;

  /// `settings` (lines `key: value`) identifies the simulation; `settings_file` keeps it.
  OutputFolder(std::filesystem::path settings_file, const std::string& settings);

  /// `there` are the existing files of the kind of `wanted`; `others` will be written, too. Throws
  /// UsageError for foreign files and for files of other settings; with `overwrite`, removes the
  /// latter. Writes the settings. Returns the wanted files that exist.
  Files open(const Files& wanted, const Files& there,
             const std::vector<std::filesystem::path>& others, bool overwrite) const;

 private:
  std::string difference(const std::string& known) const;

  std::filesystem::path settings_file_;
  std::string settings_;
};

/// Writes the file and its parent folders, unless it already has this content.
void write_text(const std::filesystem::path& file, const std::string& text);

/// `requested`: 0 means all cores. Returns at most `items`, at least 1.
int threads_for(int requested, int64_t items);

/// Calls take(item, thread) for the items [0, missing), in any order, and adds their count and time
/// to `summary`. Calls to progress() and stop() are serialized. Throws Interrupted with `folder` if
/// stop() returns true before the last item, and the exception of take() with the lowest item.
void run_scans(int64_t missing, int threads, const std::filesystem::path& folder,
               const std::function<void(int64_t item, int thread)>& take,
               const std::function<void(int64_t, int64_t)>& progress,
               const std::function<bool()>& stop, SimulationSummary& summary);

/// Writes binary PCD atomically, with `cloud.times`, one per point, as the field `time`. Throws
/// Error on failure, UsageError unless each point has a time.
void write_pcd_scan(const std::filesystem::path& file, const PointCloud& cloud);

/// Computed from the sizes of `files`: .bin, or .pcd of write_pcd_scan().
double mean_points(std::span<const std::filesystem::path> files);

/// Must be incremented with every change of scans, because older runs must not be resumed.
constexpr int kWorldVersion = 1;

class DataSet {
 public:
  DataSet(const SimulationConfig& config, const Drive& drive);

  /// Returns the frames that are already complete.
  std::set<int> open(const std::set<int>& wanted, bool overwrite);
  void write_frame(const std::string& poses, const std::string& calibration,
                   const std::string& times);

  std::filesystem::path scan_file(int frame) const;
  std::filesystem::path image_file(int frame) const;

 private:
  std::filesystem::path sequence_, poses_file_;
  bool with_images_, with_times_;
  OutputFolder folder_;
};

}  // namespace revisit::simulation
